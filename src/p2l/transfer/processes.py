"""Gaussian process classification of counts (Rasmussen and Williams, 2006, chapters 3 and 5).

Logits of N pairs are normal with mean m and covariance K(θ), successes are binomial. θ maximises Laplace's evidence
times a normal prior of each θ: with few trials the prior decides, and no θ runs away. The posterior at that θ is then
found by expectation propagation: where nearly all trials of a kind fail, the mode that Laplace stands on is too near to
0.5, and expectations are not. Axis letter: H entries of θ, all logarithms.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize, special

from p2l.records import Array, IntArray
from p2l.transfer.beliefs import LatentBelief
from p2l.transfer.few_trials import TaskPairs

_STEPS, _TOLERANCE = 60, 1e-9
_SWEEPS, _DAMPING, _SETTLED = 60, 0.7, 1e-5
_GRID = np.linspace(-7.0, 7.0, 141)  # deviations of a cavity, at which tilted moments are summed


@dataclass(frozen=True)
class Kernel:
    """A covariance of pairs.

    Attributes:
        centre, spread: [H] of θ's normal prior; the search starts at its centre.
        value: θ, pairs [Q] and [N] → covariance [Q, N], without the effect that each pair has of its own.
        diagonal: θ, pairs [Q] → variance [Q] of each, without that effect.
        slopes: θ, pairs [N] → derivatives [N, N] of `value` by each entry of θ but the last.

    The last entry of θ is the logarithm of the deviation of a pair's own effect.
    """

    centre: Array
    spread: Array
    value: Callable[[Array, TaskPairs, TaskPairs], Array]
    diagonal: Callable[[Array, TaskPairs], Array]
    slopes: Callable[[Array, TaskPairs], Sequence[Array]]


@dataclass(frozen=True)
class Mode:
    """The mode of the posterior.

    Attributes:
        weight: [N] K⁻¹ (f - m) there, so that the mean of another pair's logit is m + k · weight.
        precision: [N, N] what a prior covariance loses by the trials: k - k · precision · k.
        evidence: logarithm of the marginal likelihood, and its gradient [H].
        gradient: see evidence.
        logit: [N] at the mode.
    """

    weight: Array
    precision: Array
    evidence: float
    gradient: Array
    logit: Array


def posterior_mode(
    covariance: Array, slopes: Sequence[Array], mean: Array, successes: IntArray, attempts: IntArray, start: Array
) -> Mode:
    """Newton's method from logits `start`; all of [N], covariance and each slope [N, N]."""
    f: Array = start.copy()
    identity = np.eye(len(mean))
    weight = linalg.solve(covariance, f - mean, assume_a="pos")
    best = _log_likelihood(f, successes, attempts) - 0.5 * float(weight @ (f - mean))
    for _ in range(_STEPS):
        p = special.expit(f)
        root = np.sqrt(attempts * p * (1.0 - p))
        factor = linalg.cholesky(identity + root[:, None] * covariance * root, lower=True)
        b = root**2 * (f - mean) + successes - attempts * p
        step: Array = b - root * linalg.cho_solve((factor, True), root * (covariance @ b))
        change, scale = step - weight, 1.0
        while True:  # halve a step that overshoots; the last one is as good as none
            trial = weight + scale * change
            moved = mean + covariance @ trial
            value = _log_likelihood(moved, successes, attempts) - 0.5 * float(trial @ (moved - mean))
            if value >= best - 1e-12 or scale < 1e-6:
                break
            scale *= 0.5
        gain, best, weight, f = value - best, value, trial, moved
        if gain < _TOLERANCE:
            break
    p = special.expit(f)
    curvature = attempts * p * (1.0 - p)
    root = np.sqrt(curvature)
    factor = linalg.cholesky(identity + root[:, None] * covariance * root, lower=True)
    precision = np.asarray(root[:, None] * linalg.cho_solve((factor, True), np.diag(root)), dtype=np.float64)
    evidence = best - float(np.log(np.diag(factor)).sum())
    half = linalg.solve_triangular(factor, root[:, None] * covariance, lower=True)
    left = np.diag(covariance) - (half**2).sum(axis=0)  # posterior variances
    third = 0.5 * left * curvature * (2.0 * p - 1.0)  # of the evidence by the mode
    residual = successes - attempts * p
    gradient = []
    for slope in slopes:
        direct = 0.5 * float(weight @ slope @ weight) - 0.5 * float((precision * slope).sum())
        moved = slope @ residual
        gradient.append(direct + float(third @ (moved - covariance @ (precision @ moved))))
    return Mode(weight, precision, evidence, np.array(gradient), f)


def fit_process(
    kernel: Kernel, pairs: TaskPairs, mean: Array, successes: IntArray, attempts: IntArray, iterations: int = 40
) -> tuple[Array, Posterior]:
    """θ [H] of the largest evidence times prior, and the posterior there."""
    last = [mean.copy()]

    def loss(theta: Array) -> tuple[float, Array]:
        mode = mode_at(kernel, theta, pairs, mean, successes, attempts, last[0])
        last[0] = mode.logit
        pull = (theta - kernel.centre) / kernel.spread
        return 0.5 * float(pull @ pull) - mode.evidence, pull / kernel.spread - mode.gradient

    bounds = [(c - 4 * s, c + 4 * s) for c, s in zip(kernel.centre, kernel.spread, strict=True)]
    found = optimize.minimize(
        loss, kernel.centre, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": iterations, "ftol": 1e-7}
    )
    covariance = kernel.value(found.x, pairs, pairs) + np.exp(2.0 * found.x[-1]) * np.eye(len(pairs))
    return found.x, expectation_propagation(covariance, mean, successes, attempts, last[0])


def mode_at(
    kernel: Kernel, theta: Array, pairs: TaskPairs, mean: Array, successes: IntArray, attempts: IntArray, start: Array
) -> Mode:
    """The mode with these hyperparameters."""
    own = np.exp(2.0 * theta[-1])
    covariance = kernel.value(theta, pairs, pairs) + own * np.eye(len(pairs))
    slopes = [*kernel.slopes(theta, pairs), 2.0 * own * np.eye(len(pairs))]
    return posterior_mode(covariance, slopes, mean, successes, attempts, start)


def belief_of(
    kernel: Kernel, theta: Array, posterior: Posterior, tried: TaskPairs, query: TaskPairs, mean: Array
) -> LatentBelief:
    """What the trials of N pairs say of Q others (or the same); mean [Q] is that of the prior."""
    own = np.exp(2.0 * theta[-1])
    cross = kernel.value(theta, query, tried) + own * same_pairs(query, tried)
    reduced = cross @ posterior.precision
    variance = kernel.diagonal(theta, query) + own - (reduced * cross).sum(axis=1)
    variance = np.maximum(variance, 1e-9)

    def covariance(pair: int) -> Array:
        row = kernel.value(theta, query, query.take(np.array([pair])))[:, 0] - cross @ reduced[pair]
        row[pair] = variance[pair]
        return row

    return LatentBelief(mean + cross @ posterior.weight, variance, covariance)


@dataclass(frozen=True)
class Posterior:
    """What trials say, as `Mode`: weight [N] of the mean and precision [N, N] that takes off the covariance."""

    weight: Array
    precision: Array


def expectation_propagation(
    covariance: Array, mean: Array, successes: IntArray, attempts: IntArray, start: Array
) -> Posterior:
    """All sites at once, damped, from the curvature at logits `start` [N]."""
    p = special.expit(start)
    site = np.maximum(attempts * p * (1.0 - p), 1e-6)
    pull = site * start + successes - attempts * p
    for _ in range(_SWEEPS):
        posterior = _given_sites(covariance, mean, site, pull)
        carried = covariance @ posterior.precision
        variance = np.maximum(np.diag(covariance) - (carried * covariance).sum(axis=1), 1e-10)
        centre = mean + covariance @ posterior.weight
        cavity = np.maximum(1.0 / variance - site, 1e-8)
        cavity_mean = (centre / variance - pull) / cavity
        tilted, spread = _tilted(cavity_mean, cavity, successes, attempts)
        change = np.maximum(1.0 / spread - cavity, 1e-8) - site
        site = site + _DAMPING * change
        pull = pull + _DAMPING * (tilted / spread - cavity * cavity_mean - pull)
        if np.abs(tilted - centre).max() < _SETTLED and np.abs(spread - variance).max() < _SETTLED:
            break
    return _given_sites(covariance, mean, site, pull)


def _tilted(mean: Array, precision: Array, successes: IntArray, attempts: IntArray) -> tuple[Array, Array]:
    """Means and variances [N] of normal cavities times binomial likelihoods, on a grid, then on one that fits."""
    centre, reach = mean, 1.0 / np.sqrt(precision)
    for _ in range(2):
        f = centre + reach * _GRID[:, None]
        log_weight = successes * f - attempts * np.logaddexp(0.0, f) - 0.5 * precision * (f - mean) ** 2
        weight = np.exp(log_weight - log_weight.max(axis=0))
        weight /= weight.sum(axis=0)
        centre = (weight * f).sum(axis=0)
        variance = np.maximum((weight * (f - centre) ** 2).sum(axis=0), 1e-10)
        reach = np.maximum(np.sqrt(variance), reach * (_GRID[1] - _GRID[0]))  # the grid may be too coarse to tell
    return centre, variance


def _given_sites(covariance: Array, mean: Array, site: Array, pull: Array) -> Posterior:
    """Normal sites of these precisions [N] and precision-times-mean [N]."""
    root = np.sqrt(site)
    factor = linalg.cholesky(np.eye(len(site)) + root[:, None] * covariance * root, lower=True)
    precision = np.asarray(root[:, None] * linalg.cho_solve((factor, True), np.diag(root)), dtype=np.float64)
    b = pull - site * mean
    return Posterior(b - precision @ (covariance @ b), precision)


def same_pairs(query: TaskPairs, tried: TaskPairs) -> Array:
    """[Q, N] 1 where both are the same pair."""
    alike = (query.taught[:, None] == tried.taught) & (query.tested[:, None] == tried.tested)
    return alike.astype(np.float64)


def _log_likelihood(f: Array, successes: IntArray, attempts: IntArray) -> float:
    return float((successes * f - attempts * np.logaddexp(0.0, f)).sum())

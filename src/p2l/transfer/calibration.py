"""Probabilities that mean what they say: a monotone correction, and the scores that judge it.

The planner multiplies a predicted probability by a cost, so ranking pairs well is not enough. The correction is
Platt's: two numbers fitted by maximum likelihood to held-out logits. It cannot change a ranking and, unlike isotonic
regression, does not overfit the few held-out tasks there are. Scores take counts (successes of `draws` executions) and
optional weights per pair [..., N], by which tasks are resampled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize, special

from p2l.records import Array, IntArray

EPSILON = 1e-6  # logarithmic loss takes probabilities no nearer than this to 0 and 1
_RIDGE = 1e-3  # pulls Platt's parameters to the identity, so that separable data stay finite


@dataclass(frozen=True)
class Platt:
    """Calibrated logit = slope · logit + shift, with slope > 0."""

    slope: float = 1.0
    shift: float = 0.0

    def __call__(self, logit: Array) -> Array:
        """Probability of each logit."""
        return np.asarray(special.expit(self.slope * logit + self.shift))


def fit_platt(logit: Array, successes: IntArray, draws: int) -> Platt:
    """The maximum-likelihood Platt correction of logits [N] with binomial counts [N]."""
    share = successes / draws

    def loss(parameters: Array) -> tuple[float, Array]:
        slope = np.exp(parameters[0])
        z = slope * logit + parameters[1]
        residual = special.expit(z) - share
        value = np.mean(np.logaddexp(0.0, z) - share * z) + _RIDGE * float(parameters @ parameters)
        gradient = np.array([np.mean(residual * slope * logit), residual.mean()]) + 2 * _RIDGE * parameters
        return float(value), gradient

    optimum = optimize.minimize(loss, np.zeros(2), jac=True, method="L-BFGS-B", bounds=[(-5, 5), (-20, 20)])
    return Platt(float(np.exp(optimum.x[0])), float(optimum.x[1]))


def brier(p: Array, successes: IntArray, draws: int, weights: Array | None = None) -> Array:
    """Mean squared error of probability against each single outcome."""
    rate = successes / draws
    return _average(p**2 - 2 * p * rate + rate, weights)


def log_loss(p: Array, successes: IntArray, draws: int, weights: Array | None = None) -> Array:
    """Mean negative log likelihood of each single outcome, nats."""
    rate = successes / draws
    q = np.clip(p, EPSILON, 1 - EPSILON)
    return _average(-rate * np.log(q) - (1 - rate) * np.log1p(-q), weights)


def auc(p: Array, successes: IntArray, draws: int, weights: Array | None = None) -> Array:
    """Probability that a success was given a higher p than a failure, ties counting half; NaN if either is absent."""
    order = np.argsort(p, kind="stable")
    starts = np.flatnonzero(np.diff(p[order], prepend=-np.inf))  # one entry for each distinct p
    scale = np.ones(len(p)) if weights is None else weights
    wins = np.add.reduceat((scale * successes)[..., order], starts, axis=-1)
    losses = np.add.reduceat((scale * (draws - successes))[..., order], starts, axis=-1)
    below = np.cumsum(losses, axis=-1) - losses / 2
    with np.errstate(invalid="ignore"):
        return np.asarray((wins * below).sum(axis=-1) / (wins.sum(axis=-1) * losses.sum(axis=-1)))


def bins_of(p: Array, bins: int) -> IntArray:
    """Number [N] of the equal-width bin of each probability."""
    return np.minimum((p * bins).astype(np.int64), bins - 1)


def ece(p: Array, successes: IntArray, draws: int, weights: Array | None = None, *, bins: int = 10) -> Array:
    """Expected calibration error: |success rate − mean p| over equal-width bins, weighted by executions."""
    scale = np.ones(len(p)) if weights is None else weights
    member = np.eye(bins)[bins_of(p, bins)]  # [N, bins]
    gap = np.abs((scale * (successes / draws - p)) @ member)
    return np.asarray(gap.sum(axis=-1) / scale.sum(axis=-1))


@dataclass(frozen=True)
class Reliability:
    """One row per bin of predicted probability; empty bins have NaN means.

    Attributes:
        low, high: [B] edges of the bins.
        mean_p: [B] mean prediction of the pairs inside.
        successes, executions, pairs: [B] counts.
    """

    low: Array
    high: Array
    mean_p: Array
    successes: IntArray
    executions: IntArray
    pairs: IntArray

    @property
    def rate(self) -> Array:
        """[B] success rate; NaN in an empty bin."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.successes / self.executions)


def reliability(p: Array, successes: IntArray, draws: int, bins: int = 10) -> Reliability:
    """Counts behind a reliability diagram of predictions [N]."""
    index = bins_of(p, bins)
    pairs = np.bincount(index, minlength=bins)
    with np.errstate(invalid="ignore"):
        mean_p = np.bincount(index, p, bins) / pairs
    edges = np.linspace(0.0, 1.0, bins + 1)
    wins = np.bincount(index, successes, bins).astype(np.int64)
    return Reliability(edges[:-1], edges[1:], mean_p, wins, pairs * draws, pairs)


def _average(value: Array, weights: Array | None) -> Array:
    if weights is None:
        return np.asarray(value.mean())
    return np.asarray(weights @ value / weights.sum(axis=-1))

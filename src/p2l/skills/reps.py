"""Relative Entropy Policy Search for one-shot episodes (Peters, Mülling and Altün, 2010; thesis, section 3.5.1).

A search distribution N(mean, covariance) over skill parameters is moved towards samples of high return, as far as
a bound ε on the relative entropy between the new and the old distribution allows. The bound's multiplier, the
temperature η, minimises the dual g(η) = η ε + η log (1/N Σ exp(R / η)); a sample's weight is exp(R / η).

Deviations from the reference:
1. Episodic form without state features, as the thesis uses it: one return per episode.
2. The weighted covariance is shrunk towards its diagonal (`shrinkage`) and floored at a share of the first
   covariance: 40 samples cannot carry a full covariance of 24 parameters.

Axis letters: N samples, P parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import logsumexp, softmax

from p2l.errors import ConfigError, ShapeError
from p2l.records import Array, freeze


@dataclass(frozen=True)
class SearchDistribution:
    """A Gaussian over parameters: mean [P], covariance [P, P] (symmetric, positive definite)."""

    mean: Array
    covariance: Array

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        object.__setattr__(self, "mean", freeze("mean", self.mean, ("P",), sizes))
        object.__setattr__(self, "covariance", freeze("covariance", self.covariance, ("P", "P"), sizes))

    def sample(self, rng: np.random.Generator, n: int) -> Array:
        """[n, P] parameters."""
        factor = np.linalg.cholesky(self.covariance)
        return np.asarray(self.mean + rng.standard_normal((n, len(self.mean))) @ factor.T)


def dual(temperature: float, returns: Array, epsilon: float) -> float:
    """g(η) of the relative-entropy problem; convex in η, its minimum gives the weights that meet the bound."""
    return float(temperature * (epsilon + logsumexp(returns / temperature) - np.log(len(returns))))


def solve_temperature(returns: Array, epsilon: float, minimum: float = 1e-5) -> float:
    """The temperature η ≥ minimum that minimises the dual, by bounded scalar search on log η.

    Raises:
        ConfigError: epsilon or minimum is not positive.
        ShapeError: returns are not a non-empty vector of finite numbers.
    """
    if epsilon <= 0.0 or minimum <= 0.0:
        raise ConfigError(f"REPS: epsilon ({epsilon}) and the minimum temperature ({minimum}) must be positive")
    values = freeze("returns", returns, ("N",), {})
    if not len(values):
        raise ShapeError("returns: holds no value; REPS needs at least one sample")
    spread = float(np.ptp(values))
    if spread <= 0.0:
        return minimum
    # Shifting returns moves the dual by a constant, scaling them scales η: the search runs on unit spread.
    unit = (np.asarray(returns) - np.max(returns)) / spread
    optimum = minimize_scalar(
        lambda log_eta: dual(float(np.exp(log_eta)), unit, epsilon), bounds=(-12.0, 12.0), method="bounded"
    )
    return max(minimum, float(np.exp(optimum.x)) * spread)


def sample_weights(returns: Array, temperature: float) -> Array:
    """[N] weights that sum to 1."""
    return np.asarray(softmax(np.asarray(returns) / temperature))


def relative_entropy(weights: Array) -> float:
    """KL(weights ‖ uniform), the quantity that ε bounds on the samples."""
    positive = weights[weights > 0.0]
    return float((positive * np.log(positive * len(weights))).sum())


def divergence(new: SearchDistribution, old: SearchDistribution) -> float:
    """KL(new ‖ old) of the two Gaussians, nats. ε bounds the weights of samples only, and this not at all."""
    factor = np.linalg.cholesky(old.covariance)
    spread = np.linalg.solve(factor, np.linalg.cholesky(new.covariance))
    away = np.linalg.solve(factor, new.mean - old.mean)
    shrunk = np.log(np.abs(np.diag(spread))).sum()
    return float(0.5 * ((spread**2).sum() + away @ away - len(away)) - shrunk)


def update(
    search: SearchDistribution,
    samples: Array,
    returns: Array,
    *,
    epsilon: float,
    minimum_temperature: float = 1e-5,
    shrinkage: float = 1.0,
    floor: Array | None = None,
) -> SearchDistribution:
    """One REPS step: the weighted maximum-likelihood Gaussian.

    Args:
        search: the distribution that drew the samples.
        samples: [N, P].
        returns: [N], larger is better.
        epsilon: bound on the relative entropy of the weights, nats.
        minimum_temperature: lower end for η.
        shrinkage: 0 keeps the full weighted covariance, 1 keeps its diagonal only.
        floor: [P] smallest variances.

    Raises:
        ShapeError: unlike lengths, or NaN.
        ConfigError: shrinkage outside [0, 1].
    """
    if not 0.0 <= shrinkage <= 1.0:
        raise ConfigError(f"REPS: shrinkage must be in [0, 1], got {shrinkage}")
    sizes = {"P": len(search.mean)}
    samples = freeze("samples", samples, ("N", "P"), sizes)
    freeze("returns", returns, ("N",), sizes)
    weights = sample_weights(returns, solve_temperature(returns, epsilon, minimum_temperature))
    mean = weights @ samples
    offsets = samples - mean
    # The unbiased weighted estimate divides by 1 − Σ w²; it vanishes when a single sample holds all the weight.
    scale = 1.0 - float((weights**2).sum())
    covariance = (offsets * weights[:, None]).T @ offsets / scale if scale > 1e-6 else np.array(search.covariance)
    diagonal = np.diag(covariance)
    if floor is not None:
        diagonal = np.maximum(diagonal, floor)
    covariance = (1.0 - shrinkage) * covariance
    np.fill_diagonal(covariance, diagonal)
    return SearchDistribution(mean=mean, covariance=covariance + 1e-12 * np.eye(len(diagonal)))

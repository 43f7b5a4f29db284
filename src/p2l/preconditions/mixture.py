"""Mixtures of Gaussians as frozen records: density, samples, and how a set of states becomes one.

Axis letters: N states, D features, C components.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp

from p2l.errors import ShapeError
from p2l.records import Array, freeze


@dataclass(frozen=True)
class Mixture:
    """A density over states.

    Attributes:
        weights: [C], positive, of sum 1.
        means: [C, D].
        covariances: [C, D, D], positive definite.
    """

    weights: Array
    means: Array
    covariances: Array

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        put = object.__setattr__
        put(self, "weights", freeze("weights", self.weights, ("C",), sizes, low=0.0))
        put(self, "means", freeze("means", self.means, ("C", "D"), sizes))
        put(self, "covariances", freeze("covariances", self.covariances, ("C", "D", "D"), sizes))
        if not (self.weights > 0.0).all() or abs(self.weights.sum() - 1.0) > 1e-9:
            raise ShapeError(f"weights: {self.weights.tolist()} given; expected positive values of sum 1")
        try:
            _ = self._factors
        except np.linalg.LinAlgError as error:
            raise ShapeError("covariances: one is not positive definite; fit with more regularisation") from error

    @cached_property
    def _factors(self) -> Array:
        """[C, D, D] lower Cholesky factors."""
        return np.linalg.cholesky(self.covariances)

    @cached_property
    def _whitening(self) -> Array:
        """[C, D, D] inverses of the factors."""
        return np.linalg.inv(self._factors)

    def log_density(self, states: Array) -> Array:
        """[N] log density, nats, in the units of the states."""
        offsets = states[:, None, :] - self.means  # [N, C, D]
        mahalanobis = (np.einsum("cde,nce->ncd", self._whitening, offsets) ** 2).sum(axis=-1)
        log_det = np.log(np.diagonal(self._factors, axis1=1, axis2=2)).sum(axis=1)
        each = -0.5 * mahalanobis - log_det - 0.5 * states.shape[1] * np.log(2.0 * np.pi)
        return np.asarray(logsumexp(each + np.log(self.weights), axis=1))

    def sample(self, rng: np.random.Generator, n: int, spread: float = 1.0) -> Array:
        """[n, D] states; `spread` multiplies the standard deviations, to reach into the vicinity (Algorithm 2)."""
        component = rng.choice(len(self.weights), size=n, p=self.weights)
        noise = rng.standard_normal((n, self.means.shape[1]))
        return np.asarray(self.means[component] + spread * np.einsum("nde,ne->nd", self._factors[component], noise))

    def in_units(self, mean: Array, scale: Array) -> Mixture:
        """The density of `mean + scale · x` [D] where this is the density of x."""
        return Mixture(self.weights, mean + self.means * scale, self.covariances * np.outer(scale, scale))

    def mix(self, other: Mixture, share: float) -> Mixture:
        """A mixture of both: this density with weight 1 − share, the other with weight share, in (0, 1)."""
        return Mixture(
            np.append(self.weights * (1.0 - share), other.weights * share),
            np.concatenate([self.means, other.means]),
            np.concatenate([self.covariances, other.covariances]),
        )

    def arrays(self, prefix: str) -> dict[str, npt.NDArray[Any]]:
        """The record as arrays whose names begin with `prefix`."""
        names = ("weights", "means", "covariances")
        return {f"{prefix}{name}": np.asarray(getattr(self, name)) for name in names}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, npt.NDArray[Any]], prefix: str) -> Mixture:
        """Rebuild the record; the constructor checks it."""
        return cls(arrays[f"{prefix}weights"], arrays[f"{prefix}means"], arrays[f"{prefix}covariances"])


def standardisation(states: Array) -> tuple[Array, Array]:
    """Mean [D] and standard deviation [D] of states [N, D]; a feature that does not vary keeps its unit."""
    mean, scale = states.mean(axis=0), states.std(axis=0)
    return mean, np.where(scale > 1e-9 * np.maximum(1.0, np.abs(mean)), scale, 1.0)


def fit_gaussian(states: Array, regularisation: float) -> Mixture:
    """One Gaussian over states [N, D], N ≥ 1.

    Its covariance is the unbiased estimate plus `regularisation` · I, of the diagonal alone below 2 (D + 1) states:
    fewer leave directions without any variance.
    """
    count, width = states.shape
    offsets = states - states.mean(axis=0)
    covariance = offsets.T @ offsets / max(count - 1, 1)
    if count < 2 * (width + 1):
        covariance = np.diag(np.diag(covariance))
    covariance = covariance + regularisation * np.eye(width)
    return Mixture(np.ones(1), states.mean(axis=0)[None], covariance[None])


def fit_mixture(states: Array, components: int, regularisation: float, rng: np.random.Generator) -> Mixture:
    """Up to `components` Gaussians over states [N, D], N ≥ 2, by scikit-learn's expectation maximisation.

    There are at least 2 (D + 1) states for every component; with fewer in all, a single one with a diagonal covariance.
    """
    from sklearn.mixture import GaussianMixture

    enough = 2 * (states.shape[1] + 1)
    count = int(np.clip(min(len(states) // enough, len(np.unique(states, axis=0))), 1, components))
    if count == 1:
        return fit_gaussian(states, regularisation)
    fit = GaussianMixture(
        count, reg_covar=regularisation, n_init=2, max_iter=300, random_state=int(rng.integers(2**31))
    ).fit(states)
    positive = fit.weights_ > 0.0
    weights = fit.weights_[positive] / fit.weights_[positive].sum()
    return Mixture(weights, fit.means_[positive], fit.covariances_[positive])

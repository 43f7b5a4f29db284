"""Where may a skill be started? The generative classifier of a precondition (thesis, Algorithm 2 and section 4.4).

Start states from which the skill succeeds follow a Gaussian D⁺, the others a mixture of Gaussians D⁻; Bayes' rule
turns both densities into a probability. REPS climbs both: R(s) = 0.1 log f_D⁺(s) + 10 ρ(s).

Axis letters: N states, D features.

Deviations from the thesis:
1. D⁻ holds a broad background of small weight, a Gaussian over all samples of 3 standard deviations. Far from every
   sample, where the ratio of two tails says nothing, a state then counts as negative; else REPS would find such places.
2. Without negatives (fewer than two) D⁻ is that background alone and, unless given, the prior is a half; the
   precondition is then an ellipsoid around the positives.
3. Densities are fitted to standardised features with a small multiple of the identity added to each covariance, and
   expressed in the features' own units. Features that do not vary therefore leave no singular covariance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import expit

from p2l.errors import ConfigError, ShapeError
from p2l.preconditions.mixture import Mixture, fit_gaussian, fit_mixture, standardisation
from p2l.records import Array, BoolArray, freeze

_SPREAD = 3.0  # standard deviations of the background, in those of the samples


@dataclass(frozen=True)
class PreconditionClassifier:
    """ρ of one nominal skill.

    Attributes:
        feature_names: D names, with units.
        positive: D⁺, one Gaussian.
        negative: D⁻.
        prior: probability of a positive before looking, in (0, 1).
    """

    feature_names: tuple[str, ...]
    positive: Mixture
    negative: Mixture
    prior: float

    def __post_init__(self) -> None:
        for name, mixture in (("positive", self.positive), ("negative", self.negative)):
            if mixture.means.shape[1] != len(self.feature_names):
                raise ShapeError(
                    f"{name}: has {mixture.means.shape[1]} features; expected {len(self.feature_names)}, as named"
                )
        if not 0.0 < self.prior < 1.0:
            raise ShapeError(f"prior: {self.prior} given; expected a value strictly between 0 and 1")

    def log_density(self, states: Array) -> Array:
        """[N] log f_D⁺, nats, in the units of the features [N, D]."""
        return self.positive.log_density(self._validate(states))

    def density(self, states: Array) -> Array:
        """[N] f_D⁺."""
        return np.exp(self.log_density(states))

    def logit(self, states: Array) -> Array:
        """[N] log odds of being positive."""
        states = self._validate(states)
        odds = np.log(self.prior) - np.log1p(-self.prior)
        return np.asarray(odds + self.positive.log_density(states) - self.negative.log_density(states))

    def probability(self, states: Array) -> Array:
        """[N] ρ(s): probability that the skill succeeds from each state."""
        return np.asarray(expit(self.logit(states)))

    def holds(self, states: Array, threshold: float = 0.5) -> BoolArray:
        """[N] ρ(s) ≥ threshold."""
        return np.asarray(self.probability(states) >= threshold)

    def _validate(self, states: Array) -> Array:
        return freeze("states", states, ("N", "D"), {"D": len(self.feature_names)})

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """The record as named arrays, for `artifacts.save_arrays`."""
        names = {"feature_names": np.array(self.feature_names), "prior": np.array(self.prior)}
        return {**names, **self.positive.arrays("positive_"), **self.negative.arrays("negative_")}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> PreconditionClassifier:
        """Rebuild the record; the constructor checks it."""
        names = tuple(str(name) for name in arrays["feature_names"])
        both = Mixture.from_arrays(arrays, "positive_"), Mixture.from_arrays(arrays, "negative_")
        return cls(names, *both, float(arrays["prior"]))


def fit_classifier(
    states: Array,
    labels: BoolArray,
    feature_names: Sequence[str],
    rng: np.random.Generator,
    *,
    components: int = 5,
    regularisation: float = 1e-4,
    background: float = 0.01,
    prior: float | None = None,
) -> PreconditionClassifier:
    """Fit both densities.

    Args:
        states: [N, D] start states of executions.
        labels: [N] whether each execution reached the next precondition.
        feature_names: D names.
        rng: where expectation maximisation starts.
        components: largest number of Gaussians in D⁻, besides the background.
        regularisation: added to the variances of standardised features.
        background: weight of the background in D⁻, in (0, 1).
        prior: probability of a positive; the share of positives among the samples if not given.

    Raises:
        ShapeError: unlike lengths, NaN, or a prior outside (0, 1).
        ConfigError: fewer than two positives, or a setting out of range.
    """
    sizes = {"D": len(feature_names)}
    states = freeze("states", states, ("N", "D"), sizes)
    positive = freeze("labels", labels, ("N",), sizes, np.bool_)
    _check(int(positive.sum()), components, regularisation, background)
    mean, scale = standardisation(states)
    unit = (states - mean) / scale
    good = fit_gaussian(unit[positive], regularisation)
    bad = _background(unit, good, regularisation)
    if enough := int((~positive).sum()) >= 2:
        bad = fit_mixture(unit[~positive], components, regularisation, rng).mix(bad, background)
    if prior is None:
        prior = float(positive.mean()) if enough else 0.5
    return PreconditionClassifier(tuple(feature_names), good.in_units(mean, scale), bad.in_units(mean, scale), prior)


def _background(unit: Array, good: Mixture, regularisation: float) -> Mixture:
    """Wider than all samples and than D⁺ in every direction."""
    everything = fit_gaussian(unit, regularisation)
    return Mixture(np.ones(1), everything.means, _SPREAD**2 * (everything.covariances + good.covariances) / 2.0)


def _check(positives: int, components: int, regularisation: float, background: float) -> None:
    if positives < 2:
        raise ConfigError(
            f"precondition: {positives} successful start states given; at least 2 are needed. "
            "Collect more nominal trajectories, or check the skill that should succeed from them."
        )
    if components < 1 or not 0.0 < regularisation < np.inf or not 0.0 < background < 1.0:
        raise ConfigError(
            f"precondition: components {components}, regularisation {regularisation}, background {background} given; "
            "expected at least 1, above 0, and strictly between 0 and 1"
        )

"""How many tasks of each type may come tomorrow: expected numbers with a distribution, and scenarios drawn of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from p2l.errors import ShapeError
from p2l.records import Array, freeze
from p2l.team.tomorrow.record import TwoStage

Distribution = Literal["poisson", "fixed", "geometric", "given"]
DISTRIBUTIONS: tuple[str, ...] = get_args(Distribution)
MOST = 1000.0  # copies of a type that a forecast may expect
_SUM = 1e-9


@dataclass(frozen=True)
class Forecast:
    """Numbers of J types, independent of each other.

    Attributes:
        types: J names.
        mean: [J] expected number of copies, at most 1000.
        distribution: J of "poisson"; "fixed": exactly the mean, a whole number; "geometric": 0, 1, 2, …, each less
            probable than the one before by the same factor; "given": by `chances`.
        chances: [J, K] probability of 0 to K - 1 copies; zeros where the distribution is not "given".

    Raises:
        ShapeError: a wrong shape, a number out of range, chances that do not sum to one or not to the mean.

    Example:
        >>> import numpy as np
        >>> from p2l.team.tomorrow import Forecast, sample_counts
        >>> forecast = Forecast(("peg", "lid"), [2.0, 0.5], ("fixed", "given"), [[0, 0], [0.5, 0.5]])
        >>> sample_counts(forecast, 3, np.random.default_rng(1))[:, 0].tolist()
        [2.0, 2.0, 2.0]
    """

    types: tuple[str, ...]
    mean: Array
    distribution: tuple[Distribution, ...]
    chances: Array

    def __post_init__(self) -> None:
        put, sizes = object.__setattr__, {"J": len(self.types)}
        put(self, "mean", freeze("mean", self.mean, ("J",), sizes, low=0.0, high=MOST))
        put(self, "chances", freeze("chances", self.chances, ("J", "K"), sizes, low=0.0, high=1.0))
        if len(self.distribution) != len(self.types) or set(self.distribution) - set(DISTRIBUTIONS):
            raise ShapeError(f"distribution: {self.distribution} given; expected one of {list(DISTRIBUTIONS)} per type")
        given = np.array([each == "given" for each in self.distribution], dtype=bool)
        if (np.abs(self.chances.sum(axis=1) - 1.0)[given] > _SUM).any():
            raise ShapeError("chances: of a type do not sum to one")
        means = self.chances @ np.arange(self.chances.shape[1], dtype=np.float64)
        if (np.abs(means - self.mean)[given] > _SUM * (1.0 + self.mean[given])).any():
            raise ShapeError("mean: is not what the chances give")
        fixed = np.array([each == "fixed" for each in self.distribution], dtype=bool)
        if (self.mean[fixed] != np.floor(self.mean[fixed])).any():
            raise ShapeError("mean: of a fixed number is not whole")


def sample_counts(forecast: Forecast, samples: int, rng: np.random.Generator) -> Array:
    """[samples, J] independent draws of how many tasks of each type come."""
    counts = np.zeros((samples, len(forecast.types)))
    for j, (kind, mean) in enumerate(zip(forecast.distribution, forecast.mean.tolist(), strict=True)):
        if kind == "poisson":
            counts[:, j] = rng.poisson(mean, samples)
        elif kind == "geometric":
            counts[:, j] = rng.geometric(1.0 / (1.0 + mean), samples) - 1
        elif kind == "fixed":
            counts[:, j] = mean
        else:
            chances = forecast.chances[j]
            counts[:, j] = rng.choice(len(chances), samples, p=chances / chances.sum())
    return counts


def with_counts(program: TwoStage, counts: Array, probability: Array | None = None) -> TwoStage:
    """The same today with other scenarios; those that are alike become one.

    Args:
        program: today and tomorrow.
        counts: [S, J].
        probability: [S]; equal if none is given.
    """
    shares = np.full(len(counts), 1.0 / len(counts)) if probability is None else probability
    distinct, place = np.unique(counts, axis=0, return_inverse=True)
    merged = np.bincount(place.reshape(-1), shares)
    return replace(program, counts=distinct, probability=merged / merged.sum())

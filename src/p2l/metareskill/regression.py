"""Parameterised recovery skills: from where the robot failed to what it should do (thesis, section 4.4).

k-nearest-neighbour regression over the failures that REPS solved, with k = min(3, number of them), weights 1/distance
and standardised features, as in the author's experiments. The record holds the solved failures; scikit-learn's
regressor is built from them when it is first needed, so that arrays are all there is to store.

Deviation from the thesis, which predicts the three poses themselves, relative to the hand: unless told otherwise a
skill predicts what is to be added to a guessed motion to the mean of the target's D⁺ (`guess`). Nearest
neighbours cannot extrapolate, and where the hand must go, relative to the hand, differs from failure to failure by as
much as the failures do; the detour hardly differs. On held-out failures of the door, from the same solved queries,
recoveries to the grasped handle then succeed in 97, 70, 80 and 47 % instead of 38, 20, 20 and 7 % (straight motion).

Axis letters: S solved failures, F features, P parameters of a recovery, N failures to recover from.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from p2l.errors import ConfigError, ShapeError
from p2l.preconditions.mixture import standardisation
from p2l.records import Array, freeze

NEIGHBOURS = 3
_NONE_SOLVED = "states: no failure given; a recovery that solved none is infeasible, there is nothing to predict from"


@dataclass(frozen=True)
class ParameterisedSkill:
    """A recovery from one failure mode to one target.

    Attributes:
        states: [S, F] features of the solved failures, at least one.
        parameters: [S, P] the recovery that REPS found for each.
        mean, scale: [F] standardisation of the features.
        neighbours: largest number of neighbours.
        guess: the motion of `target.GUESSES` that parameters are added to; empty: they are the motion themselves.
    """

    states: Array
    parameters: Array
    mean: Array
    scale: Array
    neighbours: int = NEIGHBOURS
    guess: str = ""

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        put = object.__setattr__
        put(self, "states", freeze("states", self.states, ("S", "F"), sizes))
        put(self, "parameters", freeze("parameters", self.parameters, ("S", "P"), sizes))
        put(self, "mean", freeze("mean", self.mean, ("F",), sizes))
        put(self, "scale", freeze("scale", self.scale, ("F",), sizes))
        if not sizes["S"]:
            raise ShapeError(_NONE_SOLVED)
        if not (self.scale > 0.0).all():
            raise ShapeError(f"scale: holds {self.scale.min()}; expected values above 0")
        if self.neighbours < 1:
            raise ConfigError(f"neighbours: {self.neighbours} given; expected at least 1")

    def predict(self, states: Array) -> Array:
        """[N, P] parameters for failures [N, F]; those of a solved failure where the features are exactly its own.

        Raises:
            ShapeError: another number of features, or NaN.
        """
        features = freeze("states", states, ("N", "F"), {"F": self.states.shape[1]})
        if not len(features):
            return np.zeros((0, self.parameters.shape[1]))
        return np.asarray(self._regressor.predict((features - self.mean) / self.scale))

    @cached_property
    def _regressor(self) -> Any:
        from sklearn.neighbors import KNeighborsRegressor

        count = min(self.neighbours, len(self.states))
        # A tree sums squares of differences, so a state is at 0 from itself; `brute` expands them, and rounds to 1e-8.
        regressor = KNeighborsRegressor(n_neighbors=count, weights="distance", algorithm="kd_tree")
        return regressor.fit((self.states - self.mean) / self.scale, self.parameters)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """The record as named arrays, for `artifacts.save_arrays`."""
        names = ("states", "parameters", "mean", "scale", "neighbours", "guess")
        return {name: np.asarray(getattr(self, name)) for name in names}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> ParameterisedSkill:
        """Rebuild the record; the constructor checks it."""
        states, parameters = arrays["states"], arrays["parameters"]
        how = int(arrays["neighbours"]), str(arrays["guess"])
        return cls(states, parameters, arrays["mean"], arrays["scale"], *how)


def fit_skill(
    states: Array,
    parameters: Array,
    *,
    reference: Array | None = None,
    neighbours: int = NEIGHBOURS,
    guess: str = "",
) -> ParameterisedSkill:
    """A skill from solved failures.

    Args:
        states: [S, F].
        parameters: [S, P].
        reference: [any, F] states that fix the standardisation, such as all training failures of the mode; the solved
            ones if not given. With one to six solved failures their own spread says little.
        neighbours: largest number of neighbours.
        guess: the motion that parameters are added to, see `ParameterisedSkill`.
    """
    spread = np.asarray(states if reference is None else reference, dtype=np.float64)
    if not len(spread):
        raise ShapeError(_NONE_SOLVED)
    mean, scale = standardisation(spread)
    return ParameterisedSkill(states, parameters, mean, scale, neighbours, guess)

"""The shortcut of a lazy learner: options whose success is certain enough need not be simulated."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy.typing as npt

from p2l.chaining.mdp import Transitions
from p2l.records import Array, BoolArray, IntArray


class Shortcut(Protocol):
    """Learns from the outcomes of simulated options which ones need no simulation.

    Axis letters: K decisions, O observation columns.

    Attributes:
        spared: control steps that the options so far that were not simulated would have taken, by its estimate.
    """

    spared: int

    def sure(self, observation: Array, action: IntArray) -> BoolArray:
        """[K] whether `action` [K] is an option that will succeed from `observation` [K, O]."""

    def spare(self, action: IntArray) -> None:
        """Count the steps of options [K] that are not simulated in `spared`."""

    def begin(self, slots: IntArray, observation: Array, action: IntArray) -> None:
        """Decisions [K] whose actions are going to be simulated."""

    def end(self, transitions: Transitions) -> None:
        """Transitions of those decisions."""

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Everything that decides its future, for a checkpoint."""

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """From what `state` gave."""

"""What a lazy learner adds to a rollout: options whose outcome is certain enough need not be simulated."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from p2l.chaining.mdp import Transitions
from p2l.records import Array, BoolArray, IntArray


class Shortcut(Protocol):
    """Learns from the options that were simulated which ones need not be.

    Axis letters: K decisions, O observation columns.
    """

    def sure(self, observation: Array, action: IntArray) -> BoolArray:
        """[K] whether `action` [K] is an option that will succeed from `observation` [K, O]."""

    def begin(self, slots: IntArray, observation: Array, action: IntArray) -> None:
        """These decisions are simulated."""

    def end(self, told: Transitions) -> None:
        """How they came out."""

    def state(self) -> dict[str, Array]:
        """What it has learnt, for a checkpoint."""

    def restore(self, state: Mapping[str, Array]) -> None:
        """From what `state` gave."""

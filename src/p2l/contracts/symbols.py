"""What the skill graph needs to know of a world: a state in a few interpretable numbers, and where the hand is in it.

A state is computed in the same way from the truth and from the observation; the latter is the most likely state
(thesis, section 4.1, "Acting under Uncertainty").

Axis letters: N rows, D state columns.
"""

from __future__ import annotations

from typing import Protocol

from p2l.contracts.observation import Observation, Privileged
from p2l.records import Array, BoolArray


class Symbols(Protocol):
    """How a world is described to preconditions and recoveries.

    `things`, where a class has it, are the columns that tell how the things are, whatever the hand does: a guess of how
    to take hold of them needs to know (`p2l.metareskill.target`).
    """

    @property
    def names(self) -> tuple[str, ...]:
        """D columns, with units."""

    @property
    def context(self) -> tuple[int, ...]:
        """The columns that a recovery's regression looks at."""

    @property
    def far(self) -> Array:
        """[D] by how much a column may change before the state is another one; 0 where a motion does not decide it."""

    def state(self, source: Privileged | Observation) -> Array:
        """[N, D]."""

    def hand(self, source: Privileged | Observation, state: Array) -> tuple[Array, Array]:
        """Where the hand is if the rows' own objects are in `state` [N, D]: [N, 3] m, [N, 4]; world frame."""

    def fingers_closed(self, state: Array) -> BoolArray:
        """[N] whether the fingers are closed in `state`."""

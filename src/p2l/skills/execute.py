"""Many relative motions at once, from recorded states: one batch of the engine per control step, all take as long.

Axis letters: N rows, W waypoints, P parameters.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from p2l.contracts.observation import Observation
from p2l.contracts.rows import Rows
from p2l.contracts.world import World
from p2l.records import Array, BoolArray
from p2l.skills.relative import Timing, relative


@dataclass(frozen=True)
class Arrivals:
    """Where motions led.

    Attributes:
        legs: rows at the end of each of the W legs; a diverged row keeps its last sound moment.
        diverged: [N] rows whose simulation broke down.
    """

    legs: tuple[Rows, ...]
    diverged: BoolArray

    @property
    def last(self) -> Rows:
        """[N] at the end."""
        return self.legs[-1]


def without_noise(rows: Rows) -> Rows:
    """The same moments without any error of the estimator.

    "We optimistically assume the state becomes fully observable after the robot ends up in a failure state" (thesis,
    figure 4.3).
    """
    return replace(rows, noise=np.zeros_like(rows.noise))


def execute(world: World, rows: Rows, parameters: Array, timing: Timing) -> Arrivals:
    """Carry out one motion [N, P] from each of `rows`."""
    option = relative("relative", lambda _observation: parameters, timing)
    memory = option.begin(world.observe(rows))
    diverged = np.zeros(len(rows), dtype=np.bool_)
    ends = np.cumsum(timing.legs)
    legs = []
    for step in range(option.max_steps):
        decision = option.decide(Observation.unseen(len(rows)), memory, np.full(len(rows), step))
        after, _, divergence = world.advance(rows, decision.command)
        diverged |= divergence
        rows = after if not diverged.any() else _merge(rows, after, ~diverged)
        if step + 1 in ends:
            legs.append(rows)
    return Arrivals(tuple(legs), diverged)


def _merge(before: Rows, after: Rows, sound: BoolArray) -> Rows:
    """The rows `after` where they are `sound` [N], else those `before`."""
    rows = before.take(np.arange(len(before)))
    rows.put(sound, after.take(sound))
    return rows

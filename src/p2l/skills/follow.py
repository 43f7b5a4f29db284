"""Open-loop options: a few waypoints fixed at the start from what is observed then (thesis, section 4.4).

Axis letters: N rows, W waypoints.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from p2l import poses
from p2l.contracts.observation import Observation, Privileged
from p2l.contracts.option import OptionStep, from_memory
from p2l.contracts.rows import Command
from p2l.records import Array, BoolArray, IntArray


@dataclass(frozen=True)
class Waypoints:
    """A motion of N rows through W waypoints, world frame.

    Attributes:
        pos: [N, W, 3] m.
        quat: [N, W, 4] (w, x, y, z).
        grip: [N, W] 0 = open, 1 = closed, held from the end of the leg before until the end of this one.
    """

    pos: Array
    quat: Array
    grip: Array


@dataclass(frozen=True)
class Follow:
    """An option that goes from the present target through waypoints, each leg in a fixed number of control steps.

    Attributes:
        name: of the option.
        plan: waypoints from the observation at the start.
        legs: control steps of each leg, W numbers.
        settle: control steps of each leg, of its `legs`, that the target stands still at the end.
        ready: the hand-written precondition.
    """

    name: str
    plan: Callable[[Observation], Waypoints]
    legs: tuple[int, ...]
    settle: tuple[int, ...]
    ready: Callable[[Privileged], BoolArray]

    @property
    def memory_size(self) -> int:
        """The start pose and W waypoints of 8 numbers."""
        return 8 * (len(self.legs) + 1)

    @property
    def max_steps(self) -> int:
        """The sum of the legs."""
        return sum(self.legs)

    def precondition(self, truth: Privileged) -> BoolArray:
        """As written by hand."""
        return self.ready(truth)

    def begin(self, observation: Observation) -> Array:
        """The plan, after the present target."""
        way = self.plan(observation)
        start = np.concatenate(
            [observation["target_pos_m"], observation["target_quat"], np.zeros((len(observation), 1))], axis=1
        )
        points = np.concatenate([way.pos, way.quat, way.grip[..., None]], axis=2)
        return np.concatenate([start[:, None], points], axis=1).reshape(len(observation), -1)

    @from_memory
    def decide(self, observation: Observation, memory: Array, step: IntArray) -> OptionStep:  # noqa: ARG002
        """The pose on the present leg at the end of the next control step."""
        points = memory.reshape(len(memory), len(self.legs) + 1, 8)
        starts, ends, moving = self._times
        leg = np.minimum(np.searchsorted(ends, step, side="right"), len(ends) - 1)
        rows = np.arange(len(memory))
        fraction = np.minimum((step - starts[leg] + 1) / moving[leg], 1.0)
        before, after = points[rows, leg], points[rows, leg + 1]
        pos = before[:, :3] + fraction[:, None] * (after[:, :3] - before[:, :3])
        quat = poses.between(before[:, 3:7], after[:, 3:7], fraction)
        return OptionStep(Command.pose(pos, quat, after[:, 7]), memory, step >= ends[-1])

    @cached_property
    def _times(self) -> tuple[IntArray, IntArray, IntArray]:
        """[W] control steps at the start and at the end of each leg, and those in which its target moves."""
        ends = np.cumsum(self.legs)
        return ends - self.legs, ends, np.maximum(np.asarray(self.legs) - np.asarray(self.settle), 1)

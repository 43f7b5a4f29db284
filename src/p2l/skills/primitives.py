"""Primitive actions of a recovery policy: small motions along or about one axis of the end effector's frame.

"Each action primitive is defined in the robot's end-effector frame and operates only on a single dimension": ± 2 cm
along x, y, z and ± π/2 about one axis (thesis, section 5.4, "RL Training"); the gripper keeps its command. As in
robosuite's controller, a motion starts where the hand is, not at its target: a hand that presses on something stops
pressing with its first motion. The target moves on within `MOVE_STEPS`, and is held to the end of the primitive.
`GRIPS` open and close the fingers, for who has no nominal skills to do that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from p2l import poses
from p2l.contracts.observation import Observation, Privileged
from p2l.contracts.option import OptionStep, from_memory
from p2l.contracts.rows import Command
from p2l.records import Array, BoolArray, IntArray

TRANSLATION_M = 0.02
ROTATION_RAD = np.pi / 2
STEPS = 10
MOVE_STEPS = 5
FROM_HAND = 3  # version of our worlds since which a primitive starts where the hand is


@dataclass(frozen=True)
class Primitive:
    """Move by a fixed displacement in the end-effector frame, then hold.

    Attributes:
        name: e.g. `move +x` or `turn -z`.
        shift_m: [3] displacement, end-effector frame, m.
        turn_rad: [3] rotation vector, end-effector frame, rad.
        grip: command for the fingers, 0 = open, 1 = closed; None keeps it.
        from_hand: the target moves from where the hand is; otherwise from where it was, as in versions 1 and 2 of our
            worlds. A hand that was stopped by something 4 cm before its target then presses on for three control steps.
    """

    name: str
    shift_m: tuple[float, float, float]
    turn_rad: tuple[float, float, float]
    grip: float | None = None
    from_hand: bool = True

    memory_size = 15
    max_steps = STEPS
    decides_as = "primitive"  # what differs is in the memory

    @cached_property
    def _turn(self) -> Array:
        return poses.quat(poses.about(np.asarray(self.turn_rad), 1.0))

    def precondition(self, truth: Privileged) -> BoolArray:
        """Applicable everywhere."""
        return np.ones(len(truth), dtype=np.bool_)

    def begin(self, observation: Observation) -> Array:
        """Where the target starts, the new one, and the gripper's command; a shift keeps the orientation asked for."""
        orientation = poses.unit(observation["target_quat"])
        pos = observation["grip_pos_m"] + poses.image(orientation, self.shift_m)
        quat = poses.canonical(poses.product(orientation, self._turn))
        grip = observation["grip_command"] if self.grip is None else np.full((len(observation), 1), self.grip)
        start = observation["grip_pos_m" if self.from_hand else "target_pos_m"]
        return np.concatenate([start, observation["target_quat"], pos, quat, grip], axis=1)

    @from_memory
    def decide(self, observation: Observation, memory: Array, step: IntArray) -> OptionStep:  # noqa: ARG002
        """On the way to the new target, or there."""
        share = np.minimum((step + 1) / MOVE_STEPS, 1.0)
        pos = memory[:, :3] + share[:, None] * (memory[:, 7:10] - memory[:, :3])
        quat = poses.between(memory[:, 3:7], memory[:, 10:14], share)
        return OptionStep(Command.pose(pos, quat, memory[:, 14]), memory, step >= STEPS)


def _along(axis: int, size: float) -> tuple[float, float, float]:
    vector = [0.0, 0.0, 0.0]
    vector[axis] = size
    return vector[0], vector[1], vector[2]


PRIMITIVES: tuple[Primitive, ...] = (
    *(
        Primitive(f"move {sign}{label}", _along(axis, size), (0.0, 0.0, 0.0))
        for axis, label in enumerate("xyz")
        for sign, size in (("+", TRANSLATION_M), ("-", -TRANSLATION_M))
    ),
    *(
        Primitive(f"turn {sign}{label}", (0.0, 0.0, 0.0), _along(axis, size))
        for axis, label in enumerate("xyz")
        for sign, size in (("+", ROTATION_RAD), ("-", -ROTATION_RAD))
    ),
)

GRIPS: tuple[Primitive, ...] = tuple(
    Primitive(name, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), grip) for name, grip in (("open", 0.0), ("close", 1.0))
)


def of_version(version: int) -> tuple[Primitive, ...]:
    """The primitives of a version of our worlds."""
    return PRIMITIVES if version >= FROM_HAND else tuple(replace(each, from_hand=False) for each in PRIMITIVES)


def grips_beside(primitives: Sequence[object]) -> tuple[Primitive, ...]:
    """`GRIPS`, which start where these primitives do."""
    older = any(isinstance(each, Primitive) and not each.from_hand for each in primitives)
    return tuple(replace(each, from_hand=False) for each in GRIPS) if older else GRIPS

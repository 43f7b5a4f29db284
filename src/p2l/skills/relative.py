"""Motions through three poses relative to the hand, the fingers open or closed: recovery skills (thesis, section 4.4).

An open-loop option like the nominal ones: legs of a fixed number of control steps under impedance control. Its 21
parameters are, for each of three waypoints in turn, a displacement (m) and a rotation vector (rad) in the frame of the
hand at the start, and a number whose sign closes (+) or opens (−) the fingers during the leg that leads there.

Axis letters: N rows, W = 3 waypoints, P = 21 parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from p2l import poses
from p2l.contracts.observation import Observation, Privileged
from p2l.errors import ConfigError
from p2l.records import Array, BoolArray
from p2l.skills.follow import Follow, Waypoints

WAYPOINTS = 3
SIZE = 7 * WAYPOINTS
Plan = Callable[[Observation], Array]


@dataclass(frozen=True)
class Timing:
    """How long a motion takes.

    Attributes:
        legs: control steps of each leg.
        settle: control steps of each leg, of its `legs`, that the target stands still at the end.
    """

    legs: tuple[int, ...] = (12, 12, 16)
    settle: tuple[int, ...] = (0, 2, 8)

    def __post_init__(self) -> None:
        if len(self.legs) != WAYPOINTS or len(self.settle) != WAYPOINTS:
            raise ConfigError(f"motion: {len(self.legs)} legs, {len(self.settle)} settle given; expected {WAYPOINTS}")
        if not all(0 <= settle < leg for leg, settle in zip(self.legs, self.settle, strict=True)):
            raise ConfigError(f"motion: settle {self.settle} must be at least 0 and below legs {self.legs}")


def waypoints(observation: Observation, parameters: Array) -> Waypoints:
    """The motion of N rows with `parameters` [N, P], from where the hand is."""
    legs = parameters.reshape(len(observation), WAYPOINTS, 7)
    hand = poses.rotation(observation["grip_quat"])
    pos = [observation["grip_pos_m"] + poses.rotate(hand, legs[:, leg, :3]) for leg in range(WAYPOINTS)]
    quat = [poses.quat(hand * Rotation.from_rotvec(legs[:, leg, 3:6])) for leg in range(WAYPOINTS)]
    return Waypoints(np.stack(pos, axis=1), np.stack(quat, axis=1), (legs[:, :, 6] > 0.0).astype(np.float64))


def parameters_of(observation: Observation, way: Sequence[tuple[Array, Array]], fingers: Sequence[float]) -> Array:
    """[N, P] parameters of the motion of each row along `way`, the inverse of `waypoints`.

    Args:
        observation: N rows.
        way: W poses of the hand, each a position [N, 3] (world frame, m) and an orientation [N, 4].
        fingers: W numbers whose sign closes (+) or opens (−) them on the way to each.
    """
    hand = poses.rotation(observation["grip_quat"]).inv()
    legs = [
        np.column_stack(
            [
                poses.rotate(hand, pos - observation["grip_pos_m"]),
                (hand * poses.rotation(quat)).as_rotvec(),
                np.full(len(pos), grip),
            ]
        )
        for (pos, quat), grip in zip(way, fingers, strict=True)
    ]
    return np.concatenate(legs, axis=1)


def straight(observation: Observation, pos: Array, quat: Array, fingers_closed: BoolArray) -> Array:
    """[N, P] parameters of the straight motion to a pose in two legs, the fingers as there from the start.

    The third leg rests at the pose, so that fingers that close do so where the hand has arrived.

    Args:
        observation: N rows.
        pos: [N, 3] where the hand goes, world frame, m.
        quat: [N, 4].
        fingers_closed: [N] whether the fingers are closed at the pose.
    """
    hand = poses.rotation(observation["grip_quat"]).inv()
    away = poses.rotate(hand, pos - observation["grip_pos_m"])
    turn = (hand * poses.rotation(quat)).as_rotvec()
    grip = np.where(fingers_closed, 1.0, -1.0)[:, None]
    whole = np.concatenate([away, turn, grip], axis=1)
    share = np.array([0.5, 1.0, 1.0])
    shares = np.concatenate([np.tile(share[:, None], 6), np.ones((WAYPOINTS, 1))], axis=1)
    return np.asarray((whole[:, None] * shares).reshape(len(observation), SIZE))


def relative(name: str, plan: Plan, timing: Timing) -> Follow:
    """The option that plans [N, P] parameters from the observation at its start; it may start anywhere."""
    return Follow(
        name, lambda observation: waypoints(observation, plan(observation)), timing.legs, timing.settle, _anywhere
    )


def _anywhere(truth: Privileged) -> BoolArray:
    return np.ones(len(truth), dtype=np.bool_)

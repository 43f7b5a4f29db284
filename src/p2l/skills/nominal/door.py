"""Reach-and-grasp, rotate-handle and pull-handle: waypoints fixed at an option's start (thesis, section 4.4).

Assumed known, whatever the handle: the geometry of the nominal one, that is how far from the point whose noisy
position is seen its axis and the door's hinge are. The options see the handle's position with the estimator's error,
its orientation (with it the angles of latch and hinge), and where the hand and its target are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p2l import poses
from p2l.records import Array, BoolArray
from p2l.skills.follow import Follow, Waypoints
from p2l.worlds.door import Door
from p2l.worlds.handles import axis_of, grasp_pose, hinge_of
from p2l.worlds.observation import Observation, Privileged

UP = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Motion:
    """Numbers of the three motions.

    Attributes:
        before_m: reach-and-grasp comes from that far in front of the grasp,
        above_m: and aims that far above it, because the arm dips by as much on its way.
        latch_rad: rotate-handle turns the handle to there; the latch is free of the frame from 1.16 rad on, and the
            impedance gives way to the latch's spring.
        hinge_rad: pull-handle opens the door to there.
    """

    before_m: float = 0.06
    above_m: float = 0.004
    latch_rad: float = 1.46
    hinge_rad: float = 0.5


def options(world: Door, motion: Motion = Motion()) -> tuple[Follow, ...]:
    """The nominal chain."""

    def reach(seen: Observation) -> Waypoints:
        pos, quat, into = grasp_pose(seen["handle_pos_m"], seen["handle_quat"], world.finger_sign)
        pos = pos + motion.above_m * np.asarray(UP)
        way = np.stack([pos - motion.before_m * into, pos, pos], axis=1)
        return Waypoints(way, np.repeat(quat[:, None], 3, axis=1), np.tile([0.0, 0.0, 1.0], (len(seen), 1)))

    def rotate(seen: Observation) -> Waypoints:
        centre = axis_of(seen["handle_pos_m"], seen["handle_quat"])
        into = poses.rotation(seen["handle_quat"]).apply([0.0, 1.0, 0.0])
        return _arc(seen, centre, into, motion.latch_rad - seen["latch_rad"][:, 0], 3)

    def pull(seen: Observation) -> Waypoints:
        centre = hinge_of(seen["handle_pos_m"], seen["handle_quat"])
        return _arc(seen, centre, np.tile(UP, (len(seen), 1)), motion.hinge_rad - seen["hinge_rad"][:, 0], 2)

    return (
        Follow("reach_and_grasp", reach, (8, 10, 6), (0, 2, 6), can_reach),
        Follow("rotate_handle", rotate, (6, 6, 8), (0, 0, 2), can_rotate),
        Follow("pull_handle", pull, (8, 12), (0, 4), can_pull),
    )


def _arc(seen: Observation, centre: Array, axis: Array, angle: Array, legs: int) -> Waypoints:
    """From the present target about a line through `centre` [N, 3] along `axis` [N, 3], by `angle` [N], fingers closed.

    It starts from the target and not from the hand, so that what the hand presses with is kept.
    """
    pos, quat = seen["target_pos_m"], poses.rotation(seen["target_quat"])
    turns = [poses.about(axis, angle * (leg + 1) / legs) for leg in range(legs)]
    way = np.stack([centre + turn.apply(pos - centre) for turn in turns], axis=1)
    return Waypoints(way, np.stack([poses.quat(turn * quat) for turn in turns], axis=1), np.ones((len(seen), legs)))


def can_reach(truth: Privileged) -> BoolArray:
    """The door is shut, the handle at rest, the fingers open and in front of the handle."""
    shut = (truth["hinge_rad"][:, 0] < 0.05) & (np.abs(truth["latch_rad"][:, 0]) < 0.1)
    clear = (truth["grip_in_handle_m"][:, 1] < -0.05) & (truth["gap_m"][:, 0] > 0.06)
    return np.asarray(shut & clear)


def can_rotate(truth: Privileged) -> BoolArray:
    """The handle is held and the door shut."""
    return np.asarray((truth["held"][:, 0] > 0) & (truth["hinge_rad"][:, 0] < 0.05))


def can_pull(truth: Privileged) -> BoolArray:
    """The handle is held and turned."""
    return np.asarray((truth["held"][:, 0] > 0) & (truth["latch_rad"][:, 0] > 1.0))

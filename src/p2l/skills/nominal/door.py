"""Reach-and-grasp, rotate-handle and pull-handle: waypoints fixed at an option's start (thesis, section 4.4).

Assumed known: the orientation of the handle, and the nominal handle's geometry (how far its axis and the door's hinge
are from the point whose noisy position is seen).
"""

from __future__ import annotations

import numpy as np

from p2l.records import Array, BoolArray
from p2l.skills import poses
from p2l.skills.follow import Follow, Waypoints
from p2l.worlds.door import Door, grasp_pose
from p2l.worlds.handles import HANDLES
from p2l.worlds.observation import Observation, Privileged

BACK_M = 0.08
TURN_RAD = (0.5, 1.0, 1.4)
PULL_RAD = (0.15, 0.3, 0.42)
HINGE_M = 0.43
AXIS_M = HANDLES["1"].site_m


def options(world: Door) -> tuple[Follow, ...]:
    """The nominal chain."""

    def reach(seen: Observation) -> Waypoints:
        pos, quat, into = grasp_pose(seen["handle_pos_m"], seen["handle_quat"], world.finger_sign)
        way = np.stack([pos - BACK_M * into, pos, pos], axis=1)
        return Waypoints(way, np.repeat(quat[:, None], 3, axis=1), np.tile([0.0, 0.0, 1.0], (len(seen), 1)))

    return (
        Follow("reach_and_grasp", reach, (16, 16, 12), (2, 6, 12), can_reach),
        Follow("rotate_handle", rotate, (10, 10, 14), (0, 0, 4), can_rotate),
        Follow("pull_handle", pull, (12, 12, 20), (0, 0, 8), can_pull),
    )


def rotate(seen: Observation) -> Waypoints:
    """The hand turns about the axis of the handle."""
    lever = poses.rotation(seen["handle_quat"])
    axis = seen["handle_pos_m"] - lever.apply([AXIS_M, 0.0, 0.0])
    return _arc(seen["target_pos_m"], seen["target_quat"], axis, lever.apply([0.0, 1.0, 0.0]), TURN_RAD)


def pull(seen: Observation) -> Waypoints:
    """The hand turns about the hinge."""
    into = poses.rotation(seen["handle_quat"]).apply([0.0, 1.0, 0.0])
    up = np.tile([0.0, 0.0, 1.0], (len(seen), 1))
    hinge = seen["target_pos_m"] + HINGE_M * np.cross(into, up)
    return _arc(seen["target_pos_m"], seen["target_quat"], hinge, up, PULL_RAD)


def _arc(pos: Array, quat: Array, centre: Array, axis: Array, angles: tuple[float, ...]) -> Waypoints:
    turns = [poses.about(axis, np.full(len(pos), angle)) for angle in angles]
    way = np.stack([centre + turn.apply(pos - centre) for turn in turns], axis=1)
    turned = np.stack([poses.quat(turn * poses.rotation(quat)) for turn in turns], axis=1)
    return Waypoints(way, turned, np.ones((len(pos), len(angles))))


def can_reach(truth: Privileged) -> BoolArray:
    """The door is shut, the handle at rest, the fingers open and clear of it."""
    shut = (truth["hinge_rad"][:, 0] < 0.05) & (np.abs(truth["latch_rad"][:, 0]) < 0.1)
    clear = (truth["grip_in_handle_m"][:, 1] < -0.05) & (truth["gap_m"][:, 0] > 0.06)
    return np.asarray(shut & clear)


def can_rotate(truth: Privileged) -> BoolArray:
    """The handle is held and the door shut."""
    return np.asarray((truth["held"][:, 0] > 0) & (truth["hinge_rad"][:, 0] < 0.05))


def can_pull(truth: Privileged) -> BoolArray:
    """The handle is held and turned."""
    return np.asarray((truth["held"][:, 0] > 0) & (truth["latch_rad"][:, 0] > 1.0))

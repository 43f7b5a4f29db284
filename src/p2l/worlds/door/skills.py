"""Reach-and-grasp, rotate-handle and pull-handle: waypoints fixed at an option's start (thesis, section 4.4).

Assumed, whatever the handle: the geometry of the nominal one, that is how far its axis and the door's hinge are from
the point whose noisy position is observed. The options observe the handle's position with the estimator's error,
its orientation (with it the angles of latch and hinge), and where the hand and its target are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p2l import poses
from p2l.contracts.observation import Observation, Privileged
from p2l.records import Array, BoolArray
from p2l.skills.follow import Follow, Waypoints
from p2l.worlds.door.handles import axis_of, grasp_pose, hinge_of

UP = (0.0, 0.0, 1.0)
FACING = np.cos(0.5)  # the hand may be turned by up to 0.5 rad
AXIS_TO_GRASP_M = 0.08


@dataclass(frozen=True)
class Motion:
    """Numbers of the three motions.

    Attributes:
        before_m: reach-and-grasp comes from that far in front of the grasp,
        above_m: and aims that far above it, because the arm dips by as much on its way.
        latch_rad: rotate-handle turns the handle to there; the latch is free of the frame from 1.16 rad on, and the
            impedance gives way to the springs of latch and posture.
        hinge_rad: pull-handle opens the door to there.
    """

    before_m: float = 0.08
    above_m: float = 0.007
    latch_rad: float = 1.64
    hinge_rad: float = 0.5


def options(finger_sign: float, motion: Motion = Motion()) -> tuple[Follow, ...]:
    """The nominal chain of an arm that grasps with the fingers that way round (+1 or −1)."""

    def reach(observation: Observation) -> Waypoints:
        pos, quat, into = grasp_pose(observation["handle_pos_m"], observation["handle_quat"], finger_sign)
        pos = pos + motion.above_m * np.asarray(UP)
        way = np.stack([pos - motion.before_m * into, pos, pos], axis=1)
        return Waypoints(way, np.repeat(quat[:, None], 3, axis=1), np.tile([0.0, 0.0, 1.0], (len(observation), 1)))

    def rotate(observation: Observation) -> Waypoints:
        centre = axis_of(observation["handle_pos_m"], observation["handle_quat"])
        into = poses.rotate(poses.rotation(observation["handle_quat"]), [0.0, 1.0, 0.0])
        return _arc(observation, centre, into, motion.latch_rad - observation["latch_rad"][:, 0], 3)

    def pull(observation: Observation) -> Waypoints:
        centre = hinge_of(observation["handle_pos_m"], observation["handle_quat"])
        angle = motion.hinge_rad - observation["hinge_rad"][:, 0]
        return _arc(observation, centre, np.tile(UP, (len(observation), 1)), angle, 2)

    return (
        Follow("reach_and_grasp", reach, (8, 10, 6), (0, 2, 6), can_reach),
        Follow("rotate_handle", rotate, (6, 6, 8), (0, 0, 2), can_rotate),
        Follow("pull_handle", pull, (8, 12), (0, 4), can_pull),
    )


def _arc(observation: Observation, centre: Array, axis: Array, angle: Array, legs: int) -> Waypoints:
    """From the present target about a line through `centre` [N, 3] along `axis` [N, 3], by `angle` [N], fingers closed.

    It starts from the target and not from the hand, so that what the hand presses with is kept.
    """
    pos, quat = observation["target_pos_m"], poses.rotation(observation["target_quat"])
    turns = [poses.about(axis, angle * (leg + 1) / legs) for leg in range(legs)]
    way = np.stack([centre + poses.rotate(turn, pos - centre) for turn in turns], axis=1)
    quats = np.stack([poses.quat(turn * quat) for turn in turns], axis=1)
    return Waypoints(way, quats, np.ones((len(observation), legs)))


def can_reach(truth: Privileged) -> BoolArray:
    """Door shut, handle at rest, fingers open; the hand is in front of the handle and about faces the door."""
    along, depth, across = truth["grip_in_handle_m"].T
    lever, hand = poses.rotation(truth["handle_quat"]).inv(), poses.rotation(truth["grip_quat"])
    faces = poses.rotate(lever * hand, [0.0, 0.0, 1.0])[:, 1] > FACING
    upright = np.abs(poses.rotate(lever * hand, [1.0, 0.0, 0.0])[:, 2]) > FACING
    beside = np.hypot(along - AXIS_TO_GRASP_M, across)
    rest = (truth["hinge_rad"][:, 0] < 0.02) & (np.abs(truth["latch_rad"][:, 0]) < 0.1)
    return np.asarray(
        rest & faces & upright & (truth["gap_m"][:, 0] > 0.07) & (depth < -0.06) & (depth > -0.3) & (beside < 0.15)
    )


def can_rotate(truth: Privileged) -> BoolArray:
    """The handle is held firmly."""
    return _firm(truth)


def can_pull(truth: Privileged) -> BoolArray:
    """The handle is held firmly, and the latch is out of the frame: nearly turned, or the door is ajar."""
    return np.asarray(_firm(truth) & ((truth["latch_rad"][:, 0] > 1.0) | (truth["hinge_rad"][:, 0] > 0.03)))


def _firm(truth: Privileged) -> BoolArray:
    """The lever lies deep between the fingers, not at its tip, and they close on its faces, not on its edges."""
    slack = truth["slack_m"][:, 0]
    return np.asarray(
        (truth["held"][:, 0] > 0)
        & (truth["grip_in_handle_m"][:, 1] > -0.005)
        & (truth["to_tip_m"][:, 0] > 0.045)
        & (slack > -0.003)
        & (slack < 0.018)
    )

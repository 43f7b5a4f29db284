"""Grasp the handle, carry the nut over the peg, lower it, let go: waypoints fixed at an option's start.

Axis letters: N rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p2l import poses
from p2l.contracts.observation import Observation, Privileged
from p2l.records import BoolArray
from p2l.skills.follow import Follow, Waypoints
from p2l.worlds.nut.geometry import PEG_TOP_M, TABLE_M, UP, grasp_pose, yaw_off

LEVEL = float(np.cos(0.15))  # the nut is tilted by less than 0.15 rad
FACING = float(np.cos(0.5))  # the hand may be turned from the vertical by up to 0.5 rad


@dataclass(frozen=True)
class NutMotion:
    """Numbers of the four motions, m.

    Attributes:
        before_m: grasp comes from that far above the grasp,
        above_m: which is that far above the middle of the handle, so that the fingers clear the table.
        over_m: carry brings the nut that far above the top of the peg.
        low_m: lower brings the nut that far above the table.
        retreat_m: release rises by that much.
    """

    before_m: float = 0.10
    above_m: float = 0.009
    over_m: float = 0.035
    low_m: float = 0.03
    retreat_m: float = 0.12


def options(finger_sign: float, motion: NutMotion = NutMotion()) -> tuple[Follow, ...]:
    """The nominal chain of an arm that grasps with the fingers that way round (+1 or −1)."""

    def grasp(seen: Observation) -> Waypoints:
        pos, quat = grasp_pose(seen["nut_pos_m"], seen["nut_quat"], finger_sign)
        pos = pos + motion.above_m * UP
        way = np.stack([pos + motion.before_m * UP, pos, pos], axis=1)
        return Waypoints(way, np.repeat(quat[:, None], 3, axis=1), np.tile([0.0, 0.0, 1.0], (len(seen), 1)))

    def carry(seen: Observation) -> Waypoints:
        turn = poses.about(UP, -yaw_off(seen["nut_quat"]))
        over = np.array(seen["peg_pos_m"])
        over[:, 2] = PEG_TOP_M + motion.over_m
        pos, hand = seen["target_pos_m"], poses.rotation(seen["target_quat"])
        lifted = np.column_stack([pos[:, :2], pos[:, 2] + over[:, 2] - seen["nut_pos_m"][:, 2]])
        held = over + poses.rotate(turn, pos - seen["nut_pos_m"])
        quat = poses.quat(turn * hand)
        way = np.stack([lifted, held, held], axis=1)
        quats = np.stack([poses.quat(hand), quat, quat], axis=1)
        return Waypoints(way, quats, np.ones((len(seen), 3)))

    def lower(seen: Observation) -> Waypoints:
        over = seen["target_pos_m"] + (seen["peg_pos_m"] - seen["nut_pos_m"]) * [1.0, 1.0, 0.0]
        low = over - (seen["nut_pos_m"][:, 2:] - TABLE_M - motion.low_m) * UP
        way = np.stack([over, low], axis=1)
        return Waypoints(way, np.repeat(seen["target_quat"][:, None], 2, axis=1), np.ones((len(seen), 2)))

    def release(seen: Observation) -> Waypoints:
        pos = np.stack([seen["target_pos_m"], seen["grip_pos_m"] + motion.retreat_m * UP], axis=1)
        return Waypoints(pos, np.repeat(seen["target_quat"][:, None], 2, axis=1), np.zeros((len(seen), 2)))

    return (
        Follow("grasp", grasp, (16, 16, 8), (4, 10, 8), can_grasp),
        Follow("carry", carry, (12, 20, 14), (0, 2, 14), can_carry),
        Follow("lower", lower, (8, 24), (5, 8), can_lower),
        Follow("release", release, (6, 10), (6, 0), can_release),
    )


def can_grasp(truth: Privileged) -> BoolArray:
    """The nut lies flat on the table, the hand above it, facing down, fingers open."""
    above = truth["grip_pos_m"][:, 2] > TABLE_M + 0.08
    down = poses.rotate(poses.rotation(truth["grip_quat"]), [0.0, 0.0, 1.0])[:, 2] < -FACING
    return np.asarray(_lies(truth) & above & down & (truth["gap_m"][:, 0] > 0.07))


def can_carry(truth: Privileged) -> BoolArray:
    """The nut is held, level, off the peg."""
    return np.asarray(_held(truth) & (truth["nut_up"][:, 2] > LEVEL) & ~_threaded(truth))


def can_lower(truth: Privileged) -> BoolArray:
    """The nut is held, level, above the peg, and turned as it is."""
    off = truth["nut_from_peg_m"]
    over = (np.abs(off[:, :2]).max(axis=1) < 0.006) & (off[:, 2] > PEG_TOP_M - TABLE_M)
    return np.asarray(can_carry(truth) & over & (np.abs(yaw_off(truth["nut_quat"])) < 0.15))


def can_release(truth: Privileged) -> BoolArray:
    """The peg is in the hole."""
    return _threaded(truth)


def _lies(truth: Privileged) -> BoolArray:
    low = truth["nut_pos_m"][:, 2] < TABLE_M + 0.015
    return np.asarray(low & (truth["nut_up"][:, 2] > LEVEL) & ~_threaded(truth))


def _held(truth: Privileged) -> BoolArray:
    return np.asarray(truth["held"][:, 0] > 0)


def _threaded(truth: Privileged) -> BoolArray:
    off = truth["nut_from_peg_m"]
    return np.asarray((np.abs(off[:, :2]).max(axis=1) < 0.012) & (off[:, 2] < PEG_TOP_M - TABLE_M))

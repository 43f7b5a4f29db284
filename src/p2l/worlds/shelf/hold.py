"""What the detectors at the shelf remember of the hand: whether it holds the thing, and in which pose.

Axis letters: N rows, M = 12 columns of memory.
"""

from __future__ import annotations

import numpy as np

from p2l import poses
from p2l.records import Array, BoolArray

MEMORY_SIZE = 12
CLOSE_STEPS, GRASP, LIFT, FORCE, FLAG = range(5)  # of the close command: control steps; lift: ever; force: the last, N
POS, QUAT = slice(5, 8), slice(8, 12)  # pose in the hand at the lift, or at the last flag since then
CLOSING_STEPS = 5  # control steps that the fingers need
NEAR_M = 0.12  # what the closed fingers hold is not farther from the grip site
UPRIGHT = 0.1  # distance of quaternions up to which a thing stands straight
UPRIGHT_QUAT = np.array([1.0, 0.0, 0.0, 0.0])

InHand = tuple[Array, Array]  # position [N, 3], m, and quaternion [N, 4] of the thing in the frame of the grip site


def in_hand(grip_pos: Array, grip_quat: Array, object_pos: Array, object_quat: Array) -> InHand:
    """The pose in the hand from poses in the world: positions [N, 3], quaternions [N, 4]."""
    hand = poses.inverse(poses.unit(grip_quat))
    return poses.image(hand, object_pos - grip_pos), poses.product(hand, poses.unit(object_quat))


def hold(memory: Array, close_command: BoolArray, up: BoolArray, before: InHand, after: InHand) -> Array:
    """[N, M] the memory after a control step, all but force and flags.

    Args:
        memory: [N, M] before it.
        close_command: [N] whether the fingers are commanded to close.
        up: [N] whether the thing is above the table, between fingers that are not empty.
        before: the pose in the hand before the step: what a slip counts from after a flag.
        after: the same after the step: what it counts from after a lift.
    """
    new = memory.copy()
    new[:, CLOSE_STEPS] = np.where(close_command, memory[:, CLOSE_STEPS] + 1.0, 0.0)
    new[~close_command, GRASP] = 0.0
    near = np.linalg.norm(after[0], axis=1) < NEAR_M
    lift = up & near & (new[:, CLOSE_STEPS] >= CLOSING_STEPS) & (new[:, GRASP] == 0)
    new[lift, GRASP] = new[lift, LIFT] = 1.0
    flag = (new[:, GRASP] > 0) & (new[:, FLAG] > 0)
    for where, (pos, quat) in ((flag, before), (lift, after)):
        if where.any():
            new[where, POS], new[where, QUAT] = pos[where], poses.canonical(quat[where])
    return new


def slip(pose: InHand, memory: Array) -> tuple[Array, Array]:
    """Turn (rad) and shift (m), both [N], from the pose in `memory` [N, M]; 0 where nothing is in the hand."""
    pos, quat = pose
    grasp = memory[:, GRASP] > 0
    turn, shift = np.zeros(len(memory)), np.zeros(len(memory))
    if grasp.any():
        turn[grasp] = poses.angle(memory[grasp, QUAT], quat[grasp])
        shift[grasp] = np.linalg.norm(pos[grasp] - memory[grasp, POS], axis=1)
    return turn, shift


def upright_distance(quat: Array) -> Array:
    """[N] distance of quaternions [N, 4] from the closest one that stands upright; half the tilt if small."""
    return np.asarray(np.sqrt(np.maximum(2.0 - 2.0 * np.hypot(quat[:, 0], quat[:, 3]), 0.0)))


def turn_rad(quat: Array) -> Array:
    """[N] angles of the rotations [N, 4]."""
    return np.asarray(2.0 * np.arccos(np.clip(np.abs(quat[:, 0]), 0.0, 1.0)))

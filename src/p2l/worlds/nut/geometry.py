"""Nut, peg and grasp in numbers: robosuite's square nut has a handle, and a hole 7 mm wider than the peg on each side.

The nut's frame has its origin in the middle of the hole, x along the handle, z up while it lies. It fits in any of
four quarter turns.

Axis letters: N rows.
"""

from __future__ import annotations

import numpy as np

from p2l import poses
from p2l.records import Array

TABLE_M = 0.82  # height of the table's top
NUT_HALF_M = 0.01  # half of its height
HANDLE_M = 0.058  # from the middle of the hole to where the handle is grasped, clear of the ring
PEG_TOP_M = 0.95
HOLE_HALF_M, PEG_HALF_M = 0.02275, 0.016
UP = np.array([0.0, 0.0, 1.0])
DOWN = np.array([0.0, 0.0, -1.0])


def grasp_pose(nut_pos: Array, nut_quat: Array, finger_sign: float) -> tuple[Array, Array]:
    """Where a hand is that holds the handle from above: [N, 3] m and [N, 4], world frame.

    Args:
        nut_pos: [N, 3] world frame, m.
        nut_quat: [N, 4].
        finger_sign: 1 or −1, which of the two equivalent ways round the fingers are.
    """
    nut = poses.rotation(nut_quat)
    quat = poses.frame(poses.rotate(nut, [0.0, finger_sign, 0.0]), poses.rotate(nut, DOWN))
    return nut_pos + poses.rotate(nut, [HANDLE_M, 0.0, 0.0]), quat


def yaw_of(nut_quat: Array) -> Array:
    """[N] direction of the handle about the vertical, rad."""
    along = poses.rotate(poses.rotation(nut_quat), [1.0, 0.0, 0.0])
    return np.asarray(np.arctan2(along[:, 1], along[:, 0]))


def yaw_off(nut_quat: Array) -> Array:
    """[N] how far the nut is turned about the vertical from the nearest quarter turn of the peg, rad, −π/4 to π/4."""
    yaw = yaw_of(nut_quat)
    return np.asarray(yaw - np.round(yaw / (np.pi / 2)) * (np.pi / 2))

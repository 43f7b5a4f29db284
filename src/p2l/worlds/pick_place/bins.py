"""Where robosuite's two bins stand, and how much room the hand has between their walls.

Axis letters: N rows.
"""

from __future__ import annotations

import numpy as np

from p2l import poses
from p2l.records import Array

BIN1_POS_M = np.array([0.1, -0.25, 0.8])
BIN2_POS_M = np.array([0.1, 0.28, 0.8])
BIN_SIZE_M = np.array([0.39, 0.49])  # what robosuite calls the size of a bin in its task
BIN_INNER_HALF_M = np.array([0.19, 0.24])  # between the walls
QUARTER_M = BIN2_POS_M + np.array([BIN_SIZE_M[0] / 4, -BIN_SIZE_M[1] / 4, 0.0])  # centre of the bread's quarter
LIFT_M = BIN1_POS_M[2] + 0.2  # where Pick lifts to
FLOOR_M = 0.82  # height of a bin's floor; its walls end at 0.9
HAND_HALF_M = 0.102  # of the hand's long side
DOWN = (0.0, 0.0, -1.0)


def hand_room(object_pos: Array, grip_quat: Array) -> Array:
    """[N] m between the hand, lowered over the object as it is turned, and the closest wall across its long side.

    Args:
        object_pos: [N, 3] world frame, m.
        grip_quat: [N, 4] of the grip site.
    """
    along = np.abs(poses.rotate(poses.rotation(grip_quat), [1.0, 0.0, 0.0])[:, :2])
    free = BIN_INNER_HALF_M - np.abs(object_pos[:, :2] - BIN1_POS_M[:2])
    return np.asarray(np.where(along[:, 0] > along[:, 1], free[:, 0], free[:, 1]) - HAND_HALF_M)

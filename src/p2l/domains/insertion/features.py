"""What the predictor sees of a task: distances to the next wall in four directions, and the offset of the nearest one.

Walls are in the frame of their slot: origin at the centre of the slot's mouth, m.

Axis letters: A walls of a scene.
"""

from __future__ import annotations

import numpy as np

from p2l.records import Array

PART_HALF_WIDTH = 0.005
WALLS_PER_SCENE = 8
REACH = 0.06  # walls farther away cannot be touched
# Faces farther than this are beyond every skill; the feature saturates there.
FEATURE_CAP_CM = 4.0
DIRECTIONS = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]])
DISTANCE_NAMES = ("wall_left_cm", "wall_right_cm", "wall_bottom_cm", "wall_top_cm")
FEATURE_NAMES = (*DISTANCE_NAMES, "nearest_wall_x_cm", "nearest_wall_y_cm")


def wall_distances_cm(walls: Array) -> Array:
    """[4] distance from the slot's centre to the next wall face left, right, below and above, saturated at 4 cm.

    A wall counts in a direction if it overlaps the strip that the part sweeps when it moves there.
    """
    distances = np.full(4, FEATURE_CAP_CM)
    for x, y, half_x, half_y in walls:
        for index, (axis, centre, half, across, half_across) in enumerate(
            (
                (-1, x, half_x, y, half_y),
                (1, x, half_x, y, half_y),
                (-1, y, half_y, x, half_x),
                (1, y, half_y, x, half_x),
            )
        ):
            face = axis * centre - half
            if face > 0.0 and abs(across) < half_across + PART_HALF_WIDTH:
                distances[index] = min(distances[index], 100.0 * face)
    return distances


def task_features(walls: Array) -> Array:
    """[6] what the predictor sees of a task, in the order of `FEATURE_NAMES`.

    The last two are the offset to the nearest face, the wall that a demonstration leans on (the sum of the offsets
    where several are equally near, since it may lean on any of them).
    """
    distances = wall_distances_cm(walls)
    nearest = distances <= distances.min() + 1e-6
    return np.concatenate([distances, (nearest * distances) @ DIRECTIONS])

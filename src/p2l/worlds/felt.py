"""What the wrist has felt in the last control steps, as a coarse sequence: part of a row, so that a failure keeps it.

A state at a failure says where the hand is; whether it ran into something from below or from the side, just now or half
a second ago, only the force before it tells. The levels are coarse, as a real sensor's are after its drift and noise.

Axis letters: N rows, L = 3 · `MOMENTS` levels, the newest moment first.
"""

from __future__ import annotations

import numpy as np

from p2l.records import Array

MOMENTS = 8  # control steps
LEVEL_N = 15.0  # of a level
MOST = 3.0  # levels to either side
FELT_SIZE = 3 * MOMENTS


def felt_force(past: Array, force: Array) -> Array:
    """[N, L] the sequence after a control step.

    Args:
        past: [N, L] before it.
        force: [N, 3] its mean force in the frame of the wrist's sensor, N.
    """
    level = np.trunc(np.clip(force / LEVEL_N, -MOST, MOST))
    return np.concatenate([level, past[:, :-3]], axis=1)

"""Costs as arrays: at least 0, and infinite where something is not possible."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from p2l.errors import ShapeError
from p2l.records import Array, freeze

LARGEST = 1e100  # sums of larger costs overflow; infinity stands for what is not possible


def freeze_cost(name: str, value: npt.ArrayLike, shape: tuple[int | str, ...], sizes: dict[str, int]) -> Array:
    """A read-only array of costs, at least 0; infinity stands for what is not possible.

    Raises:
        ShapeError: as `records.freeze`, NaN included.
    """
    array: Array = freeze(name, value, shape, sizes, low=0.0, finite=False)
    if np.isnan(array).any():
        raise ShapeError(f"{name}: holds NaN at {np.argwhere(np.isnan(array))[0].tolist()}")
    if (largest := array.max(initial=0.0, where=np.isfinite(array))) > LARGEST:
        raise ShapeError(
            f"{name}: holds {largest}; expected values of at most 1e+100, or infinity for what is not possible"
        )
    return array

"""Frozen records that cross rooms, and the checks that run when one is born.

Axis letters are declared once and used in every docstring: N rows of a batch, T time steps, K skills, M tasks,
F features, P parameters, R repetitions (noise draws).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from p2l.errors import ShapeError

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


def freeze(
    name: str,
    value: npt.ArrayLike,
    shape: tuple[int | str, ...],
    sizes: dict[str, int],
    dtype: npt.DTypeLike = np.float64,
    *,
    finite: bool = True,
    low: float | None = None,
    high: float | None = None,
) -> npt.NDArray[Any]:
    """Return `value` as a read-only contiguous array after checking its shape, finiteness and range.

    A letter in `shape` is bound in `sizes` by the first array that uses it and must agree afterwards.

    Raises:
        ShapeError: names the array, what was given and what is allowed.
    """
    if isinstance(value, np.ma.MaskedArray) and np.ma.getmaskarray(value).any():
        raise ShapeError(f"{name}: is masked; fill in what is missing")
    try:
        raw = np.asarray(value)
    except ValueError as error:
        raise ShapeError(f"{name}: its rows have different lengths; expected a rectangular array") from error
    if raw.dtype.kind == "c":
        raise ShapeError(f"{name}: holds complex numbers; expected real ones")
    if raw.dtype.kind not in "biufO":
        raise ShapeError(f"{name}: holds {raw.dtype} values; expected numbers")
    try:
        array = np.array(raw, dtype=dtype, order="C")
    except (TypeError, ValueError, OverflowError) as error:
        raise ShapeError(f"{name}: holds {raw.dtype} values that are not numbers ({error})") from error
    if array.dtype.kind in "iu" and raw.dtype.kind == "f" and not np.array_equal(raw, array):
        raise ShapeError(f"{name}: holds values that are not whole numbers; expected integers")
    if array.ndim != len(shape):
        raise ShapeError(f"{name}: has {array.ndim} axes {array.shape}; expected {len(shape)} axes {list(shape)}")
    for axis, (length, letter) in enumerate(zip(array.shape, shape, strict=True)):
        size = letter if isinstance(letter, int) else sizes.setdefault(letter, length)
        if length != size:
            raise ShapeError(f"{name}: axis {axis} has length {length}; expected {letter} = {size}")
    if finite and np.issubdtype(array.dtype, np.floating) and not np.isfinite(array).all():
        raise ShapeError(f"{name}: holds NaN or infinity at {np.argwhere(~np.isfinite(array))[0].tolist()}")
    if low is not None and array.size and array.min() < low:
        raise ShapeError(f"{name}: holds {array.min()}; expected values of at least {low}")
    if high is not None and array.size and array.max() > high:
        raise ShapeError(f"{name}: holds {array.max()}; expected values of at most {high}")
    array.setflags(write=False)
    return array


@dataclass(frozen=True)
class TransferData:
    """What Algorithm 1 collects: how often the skill learnt on one task solves another (thesis, section 3.3.2).

    Attributes:
        names: M task names.
        features: [M, F] task features τ, in the units that `feature_names` gives.
        feature_names: F names.
        group: [M] the environment or part that each task comes from.
        train_task: [K] index of the task on which skill k was learnt.
        successes: [K, M] successful executions of skill k on task m.
        draws: noise draws per pair; success rates are `successes / draws`.
        skills: [K, P] learnt skill parameters (padded with NaN where lengths differ).
    """

    names: tuple[str, ...]
    features: Array
    feature_names: tuple[str, ...]
    group: IntArray
    train_task: IntArray
    successes: IntArray
    draws: int
    skills: Array

    def __post_init__(self) -> None:
        if self.draws < 1:
            raise ShapeError(f"draws: given {self.draws}; expected at least 1")
        sizes = {"M": len(self.names), "F": len(self.feature_names)}
        put = object.__setattr__
        put(self, "features", freeze("features", self.features, ("M", "F"), sizes))
        put(self, "group", freeze("group", self.group, ("M",), sizes, np.int64))
        task = freeze("train_task", self.train_task, ("K",), sizes, np.int64, low=0, high=sizes["M"] - 1)
        put(self, "train_task", task)
        counts = freeze("successes", self.successes, ("K", "M"), sizes, np.int64, low=0, high=self.draws)
        put(self, "successes", counts)
        put(self, "skills", freeze("skills", self.skills, ("K", "P"), sizes, finite=False))

    @property
    def rate(self) -> Array:
        """[K, M] success rates."""
        return np.asarray(self.successes / self.draws, dtype=np.float64)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """The record as named arrays, for `artifacts.save_arrays`."""
        return {
            "names": np.array(self.names),
            "features": self.features,
            "feature_names": np.array(self.feature_names),
            "group": self.group,
            "train_task": self.train_task,
            "successes": self.successes,
            "draws": np.array(self.draws),
            "skills": self.skills,
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> TransferData:
        """Rebuild the record; the constructor checks it."""
        return cls(
            names=tuple(str(name) for name in arrays["names"]),
            features=arrays["features"],
            feature_names=tuple(str(name) for name in arrays["feature_names"]),
            group=arrays["group"],
            train_task=arrays["train_task"],
            successes=arrays["successes"],
            draws=int(arrays["draws"]),
            skills=arrays["skills"],
        )

"""The state of an execution, which with the commands to come decides its future, and the command of a control step.

Axis letters: N rows, S state columns, D sensor values, E estimated coordinates, M columns of a world's memory.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from p2l.contracts.observation import NamedColumns
from p2l.errors import ShapeError
from p2l.records import Array, IntArray


@dataclass(frozen=True)
class Rows:
    """N executions at one moment; with the commands to come it decides their future to the bit.

    Attributes:
        states: [N, S] rows of the engine.
        sensors: [N, D] last sensor values.
        model: [N] which of the engine's models each row uses.
        noise: [N, K, E] unit normals of the state estimator, see `contracts.estimator`.
        actions: [N] actions (options or primitives) finished so far.
        memory: [N, M] what the world's failure detectors remember, e.g. the pose of a box in the hand.
        grip: [N] last command to the fingers, 0 = open, 1 = closed.
    """

    states: Array
    sensors: Array
    model: IntArray
    noise: Array
    actions: IntArray
    memory: Array
    grip: Array

    def __len__(self) -> int:
        return len(self.states)

    def take(self, index: npt.ArrayLike) -> Rows:
        """The rows of `index` (integers or a mask), in that order."""
        rows = np.asarray(index)
        if rows.dtype == np.bool_:
            rows = np.flatnonzero(rows)
        return Rows(**{name: getattr(self, name).take(rows, axis=0) for name in FIELDS})

    def window(self, row: int) -> Rows:
        """One row, on the memory of this record: what is written there later shows in it."""
        return Rows(**{name: value[row : row + 1] for name, value in self.arrays().items()})

    def put(self, index: npt.ArrayLike, rows: Rows) -> None:
        """Overwrite the rows of `index`; only who made this record's arrays may do so (the runner's slots)."""
        where = np.asarray(index)
        for name in FIELDS:
            getattr(self, name)[where] = getattr(rows, name)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """The fields by name, for `artifacts.save_arrays`."""
        return {name: getattr(self, name) for name in FIELDS}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> Rows:
        """From what `arrays` gave.

        Raises:
            ShapeError: the fields do not have the same number of rows, or hold NaN.
        """
        rows = cls(**{name: np.array(arrays[name]) for name in FIELDS})
        counts = {name: len(value) for name, value in rows.arrays().items()}
        if len(set(counts.values())) > 1:
            raise ShapeError(f"rows: the fields have different numbers of rows: {counts}")
        if bad := [name for name, value in rows.arrays().items() if not np.isfinite(value).all()]:
            raise ShapeError(f"rows: {', '.join(bad)} hold NaN or infinity")
        return rows

    @classmethod
    def join(cls, parts: Sequence[Rows]) -> Rows:
        """The rows of all parts, in order."""
        return cls(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in FIELDS})


FIELDS = tuple(field.name for field in fields(Rows))  # asking for them anew costs more than a copy of some rows

POSE: Mapping[str, slice] = {"pos_world_m": slice(0, 3), "quat_world": slice(3, 7), "grip": slice(7, 8)}


class Command(NamedColumns):
    """What is commanded for the next control step, [N, C]; a world names its columns (`World.command_columns`).

    The columns of a hand that follows an impedance target are `POSE`.
    """

    @classmethod
    def pose(cls, pos: Array, quat: Array, grip: Array) -> Command:
        """The target of the hand.

        Args:
            pos: [N, 3] of the grip site's target, world frame, m.
            quat: [N, 4] of the target, (w, x, y, z).
            grip: [N] 0 = fingers open, 1 = closed.
        """
        return cls(POSE, np.concatenate([pos, quat, np.reshape(grip, (len(pos), 1))], axis=1))

    @property
    def pos(self) -> Array:
        """[N, 3] of `POSE`."""
        return self.values[:, 0:3]

    @property
    def quat(self) -> Array:
        """[N, 4] of `POSE`."""
        return self.values[:, 3:7]

    @property
    def grip(self) -> Array:
        """[N] of `POSE`."""
        return self.values[:, 7]

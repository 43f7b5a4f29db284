"""The state of the world at a moment, as arrays with named columns; two types that cannot be mixed up.

`Privileged` is the truth of the simulator: failure discovery, preconditions and labels may read it. `Observation` is
what a deployed robot has: proprioception, noisy estimates, a thresholded force, the number of actions so far, and a
short history of these. Options and policies take observations only. Units stand in the field names; positions are in
the world frame unless the name says otherwise; quaternions are (w, x, y, z).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from p2l.errors import ShapeError
from p2l.records import Array


@dataclass(frozen=True)
class NamedColumns:
    """[N, C] values whose columns have names."""

    columns: Mapping[str, slice]
    values: Array

    @classmethod
    def of(cls, fields: Mapping[str, npt.NDArray[np.generic]]) -> Self:
        """From fields [N] or [N, d] by name."""
        columns: dict[str, slice] = {}
        parts, start = [], 0
        for name, value in fields.items():
            part = np.asarray(value, dtype=np.float64)
            parts.append(part[:, None] if part.ndim == 1 else part)
            stop = start + parts[-1].shape[1]
            columns[name], start = slice(start, stop), stop
        return cls(columns, np.concatenate(parts, axis=1))

    def __getitem__(self, name: str) -> Array:
        """[N, d] values of one field.

        Raises:
            ShapeError: no such field.
        """
        if name not in self.columns:
            raise ShapeError(f"no field '{name}'; fields: {', '.join(self.columns)}")
        return self.values[:, self.columns[name]]

    def __len__(self) -> int:
        return len(self.values)

    @property
    def names(self) -> tuple[str, ...]:
        """C column names: a field's name, with an index where it has several columns."""
        return tuple(
            name if where.stop - where.start == 1 else f"{name}[{index}]"
            for name, where in self.columns.items()
            for index in range(where.stop - where.start)
        )

    def take(self, index: npt.ArrayLike) -> Self:
        """The rows of `index`."""
        return type(self)(self.columns, self.values[np.asarray(index)])


class Privileged(NamedColumns):
    """The simulator's truth."""


class Observation(NamedColumns):
    """What a deployed policy observes."""

    @classmethod
    def unseen(cls, rows: int) -> Observation:
        """N rows without fields, for what decides without looking (`contracts.option.from_memory`)."""
        return cls({}, np.empty((rows, 0)))

    @classmethod
    def stack(cls, history: Sequence[Observation]) -> Observation:
        """The newest observation first, then older ones as fields `<name>@-1`, `<name>@-2` and so on.

        Args:
            history: oldest last; all of the same fields.
        """
        fields = {
            (name if age == 0 else f"{name}@-{age}"): past[name]
            for age, past in enumerate(history)
            for name in past.columns
        }
        return cls.of(fields)

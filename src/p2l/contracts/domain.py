"""The contract between a task distribution and Algorithm 1 (thesis, section 3.3.2).

Axis letters: M tasks, K skills, F features, P skill parameters, R noise draws.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal, Protocol, cast, runtime_checkable

import numpy as np
import numpy.typing as npt

from p2l.errors import ShapeError
from p2l.records import Array, BoolArray, IntArray, freeze

Encoding = Literal["difference", "concatenation", "walls"]
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Tasks:
    """Tasks of one domain, as rows of arrays.

    Attributes:
        names: M task names, e.g. `brick_4x2/3`.
        features: [M, F] what the precondition predictor sees of each task.
        group: [M] the environment, part or board region that each task comes from.
        payload: what the world needs besides, by name; every array has M rows.
    """

    names: tuple[str, ...]
    features: Array
    group: IntArray
    payload: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        sizes = {"M": len(self.names)}
        put = object.__setattr__
        put(self, "names", tuple(self.names))
        put(self, "features", freeze("features", self.features, ("M", "F"), sizes))
        put(self, "group", freeze("group", self.group, ("M",), sizes, np.int64))
        payload: dict[str, npt.NDArray[Any]] = {}
        for name, value in self.payload.items():
            array = np.array(value, order="C")
            if array.ndim == 0 or array.shape[0] != len(self):
                raise ShapeError(f"payload '{name}': has shape {array.shape}; expected {len(self)} rows, one per task")
            array.setflags(write=False)
            payload[name] = array
        put(self, "payload", MappingProxyType(payload))

    def __len__(self) -> int:
        return len(self.names)

    def take(self, index: npt.ArrayLike) -> Tasks:
        """The rows of `index`, in that order (a row may repeat)."""
        rows = cast(IntArray, np.atleast_1d(np.asarray(index, dtype=np.int64)))
        return Tasks(
            names=tuple(self.names[i] for i in rows),
            features=self.features[rows],
            group=self.group[rows],
            payload={name: array[rows] for name, array in self.payload.items()},
        )

    def join(self, other: Tasks) -> Tasks:
        """These tasks followed by those of `other`, which must have the same features and payload."""
        return Tasks(
            names=self.names + other.names,
            features=np.concatenate([self.features, other.features]),
            group=np.concatenate([self.group, other.group]),
            payload={name: np.concatenate([array, other.payload[name]]) for name, array in self.payload.items()},
        )


@dataclass(frozen=True)
class InsertionView:
    """How a skill inserts: walls [A, 4] and paths of the tip [R, T, 3] in the slot's frame, m; success [R]."""

    name: str
    walls: Array
    slot_half_width: float
    paths: Array
    success: BoolArray


@dataclass(frozen=True)
class TapView:
    """How a skill taps: centres of the part's cells [C, 2], their side, taps [T, 2], what one firms up; all cm."""

    name: str
    cells: Array
    cell_cm: float
    taps: Array
    radius_cm: float


View = InsertionView | TapView


@runtime_checkable
class Domain(Protocol):
    """A distribution of tasks, a way to learn a skill for one of them, and a simulation of that skill on others."""

    @property
    def name(self) -> str:
        """The registered name."""

    @property
    def feature_names(self) -> tuple[str, ...]:
        """F names, with units where a feature has one."""

    @property
    def encoding(self) -> Encoding:
        """How the predictor sees a pair, see `transfer.encodings`: `τ_train − τ_test`, `[τ_train, τ_test]`, or more."""

    def sample_tasks(self, rng: np.random.Generator, n: int) -> Tasks:
        """N tasks from which Algorithm 1 collects its data."""

    def sample_set(self, rng: np.random.Generator, n: int) -> Tasks:
        """One planning problem: n tasks in work order, as they arrive on the day."""

    def learn(self, tasks: Tasks, index: IntArray, rng: np.random.Generator, progress: Progress | None = None) -> Array:
        """Learn one skill per entry of `index` [K]; returns parameters [K, P] (NaN where lengths differ)."""

    def evaluate(
        self,
        skills: Array,
        learnt_on: Tasks,
        tasks: Tasks,
        draws: int,
        rng: np.random.Generator,
        progress: Progress | None = None,
    ) -> BoolArray:
        """Run skill k (learnt on row k of `learnt_on`) on task m in noise draw r: success [K, M, R].

        The draws of a task are shared by all skills, so that differences between skills are not noise.
        """

    def view(self, skill: Array, task: Tasks, rng: np.random.Generator) -> View:
        """What the skill [P] does on one task, for a figure."""

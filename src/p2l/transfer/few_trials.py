"""Tasks with features, and a few trials between them: what a person who teaches a robot has written down.

Axis letters of this and the following modules: M tasks, F numeric features, C same-or-not features, N tried pairs, Q
pairs that are asked about. A pair is ordered: the skill of a lesson on the taught task, tried on the tested task.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from p2l.errors import ShapeError
from p2l.records import Array, IntArray, freeze

SAME_TASK, SAME_FAMILY, OTHER = 0, 1, 2  # groups of pairs
_WIDE = 10.0  # a positive feature whose largest value is so many times its smallest is compared by ratios


@dataclass(frozen=True)
class TaskTable:
    """Tasks and what is known of each.

    Attributes:
        names: M distinct task names.
        numeric_names: F names.
        numeric: [M, F] features in units of the person's.
        category_names: names of the categorical features.
        category: [M, categories] number of each task's value.
        family: [M] number of each task's family; None if no family is told.
    """

    names: tuple[str, ...]
    numeric_names: tuple[str, ...]
    numeric: Array
    category_names: tuple[str, ...]
    category: IntArray
    family: IntArray | None = None

    def __post_init__(self) -> None:
        put = object.__setattr__
        sizes = {"M": len(self.names), "F": len(self.numeric_names), "C": len(self.category_names)}
        if not self.names or len(set(self.names)) < len(self.names):
            raise ShapeError(f"names: {len(self.names)} given; expected at least one, and each once")
        put(self, "numeric", freeze("numeric", self.numeric, ("M", "F"), sizes))
        put(self, "category", freeze("category", self.category, ("M", "C"), sizes, np.int64))
        if self.family is not None:
            put(self, "family", freeze("family", self.family, ("M",), sizes, np.int64))

    @property
    def standardised(self) -> Array:
        """[M, F'] numeric features of mean 0 and deviation 1; those that never vary are left out.

        A positive feature that spans a factor of ten or more enters by its logarithm: 2 to 4 mm is as far as 20 to 40.
        """
        low, high = self.numeric.min(axis=0), self.numeric.max(axis=0)
        wide = (low > 0.0) & (high >= _WIDE * low)
        values = np.where(wide, np.log(np.where(wide, self.numeric, 1.0)), self.numeric)
        values = values[:, high > low]
        centred = values - values.mean(axis=0)
        return np.asarray(centred / np.sqrt((centred**2).mean(axis=0)))


@dataclass(frozen=True)
class Trials:
    """Counts of distinct ordered pairs, [N] each.

    Attributes:
        taught: index of the task whose skill was tried.
        tested: index of the task that it was tried on.
        successes: of `attempts`.
        attempts: at least 1.
    """

    taught: IntArray
    tested: IntArray
    successes: IntArray
    attempts: IntArray

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        for name in ("taught", "tested", "successes", "attempts"):
            low = 1 if name == "attempts" else 0
            value = freeze(name, getattr(self, name), ("N",), sizes, np.int64, low=low)
            object.__setattr__(self, name, value)
        if (self.successes > self.attempts).any():
            raise ShapeError("successes: exceed the attempts of a pair")
        if len(np.unique(np.stack([self.taught, self.tested]), axis=1).T) < len(self):
            raise ShapeError("taught, tested: a pair comes twice; pool its trials")

    def __len__(self) -> int:
        return len(self.taught)

    @classmethod
    def none(cls) -> Trials:
        """No trials."""
        empty = np.zeros(0, dtype=np.int64)
        return cls(empty, empty, empty, empty)

    @classmethod
    def pooled(cls, taught: IntArray, tested: IntArray, successes: IntArray, attempts: IntArray) -> Trials:
        """Trials whose pairs may come several times."""
        pairs = np.stack([taught, tested]).astype(np.int64)
        distinct, index = np.unique(pairs, axis=1, return_inverse=True)
        sums = [np.bincount(index.ravel(), each, distinct.shape[1]).astype(np.int64) for each in (successes, attempts)]
        return cls(distinct[0], distinct[1], sums[0], sums[1])

    def take(self, rows: IntArray) -> Trials:
        """Some of them."""
        return Trials(self.taught[rows], self.tested[rows], self.successes[rows], self.attempts[rows])


@dataclass(frozen=True)
class Prior:
    """What is believed before any trial: success by kind of pair, and how many trials that is worth.

    Attributes:
        same_task: success on the taught task itself, another time.
        same_family: on another task of its family.
        other: on a task of another family.
        pseudo_count: attempts that the belief about one pair counts for.
    """

    same_task: float = 0.9
    same_family: float = 0.6
    other: float = 0.1
    pseudo_count: float = 2.0

    def __post_init__(self) -> None:
        for name in ("same_task", "same_family", "other"):
            if not 0.0 < getattr(self, name) < 1.0:
                raise ShapeError(f"{name}: {getattr(self, name)} given; expected a probability between 0 and 1")
        if not self.pseudo_count > 0.0:
            raise ShapeError(f"pseudo_count: {self.pseudo_count} given; expected more than 0")

    def of_groups(self, has_family: bool) -> Array:
        """[3] success by group; without families, tasks that differ are half alike."""
        half = 0.5 * (self.same_family + self.other)
        middle = (self.same_family, self.other) if has_family else (half, half)
        return np.array([self.same_task, *middle])


@dataclass(frozen=True)
class TaskPairs:
    """Ordered pairs as models see them.

    Attributes:
        taught, tested: [Q] task indices.
        signed: [Q, F] standardised features of the tested minus those of the taught task.
        excess: [Q, F] how much farther apart they are than two tasks on average; 0 for a task and itself, of which the
            stated prior says all.
        same: [Q, C] 1 where both have the same category (one column each), family (if told), and are the same task.
        group: [Q] SAME_TASK, SAME_FAMILY or OTHER (without families, never SAME_FAMILY).
        both: [Q, ·] features of the taught, then of the tested task: standardised ones and category numbers.
    """

    taught: IntArray
    tested: IntArray
    signed: Array
    excess: Array
    same: Array
    group: IntArray
    both: Array

    def __len__(self) -> int:
        return len(self.taught)

    def take(self, rows: IntArray) -> TaskPairs:
        """Some of them."""
        return TaskPairs(*(getattr(self, field.name)[rows] for field in fields(self)))

    @property
    def size(self) -> Array:
        """[Q, F] how far apart the tasks are in each feature."""
        return np.abs(self.signed)

    @property
    def linear(self) -> Array:
        """[Q, 2F + C] what a linear model takes."""
        return np.hstack([self.excess, self.signed, self.same])

    @property
    def differences(self) -> Array:
        """[Q, 2F + C] sizes, signed values, and what is the same."""
        return np.hstack([self.size, self.signed, self.same])


def pairs_of(tasks: TaskTable, taught: IntArray, tested: IntArray) -> TaskPairs:
    """The pairs of these task indices [Q]."""
    values = tasks.standardised
    itself = taught == tested
    alike = tasks.category[taught] == tasks.category[tested]
    relative = itself if tasks.family is None else tasks.family[taught] == tasks.family[tested]
    columns = [alike, *([] if tasks.family is None else [relative[:, None]]), itself[:, None]]
    one_hot = [tasks.category] if tasks.family is None else [tasks.category, tasks.family[:, None]]
    described = np.hstack([values, *one_hot])
    signed = values[tested] - values[taught]
    m = len(values)
    typical = np.abs(values[:, None] - values).sum(axis=(0, 1)) / max(1, m * (m - 1))
    return TaskPairs(
        taught=taught,
        tested=tested,
        signed=signed,
        excess=np.where(itself[:, None], 0.0, np.abs(signed) - typical),
        same=np.hstack(columns).astype(np.float64),
        group=np.where(itself, SAME_TASK, np.where(relative, SAME_FAMILY, OTHER)),
        both=np.hstack([described[taught], described[tested]]),
    )


def all_pairs(tasks: TaskTable) -> TaskPairs:
    """Every ordered pair, M · M of them, the tested task fastest."""
    m = len(tasks.names)
    return pairs_of(tasks, np.repeat(np.arange(m), m), np.tile(np.arange(m), m))

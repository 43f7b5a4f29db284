"""What was trained so far and what came of it: the only thing that a chooser decides on."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from p2l.errors import ShapeError
from p2l.records import Array, IntArray, freeze


@dataclass(frozen=True)
class Trained:
    """What one training of a recovery reports.

    Attributes:
        q: success rate on held-out failures of the mode.
        trials: held-out failures behind it; 0 if it was not measured.
        solved: the query found a recovery for its own failure state.

    Example:
        >>> from p2l import Trained
        >>> Trained(q=0.75, trials=20)
        Trained(q=0.75, trials=20, solved=True)
    """

    q: float
    trials: int = 0
    solved: bool = True

    def __post_init__(self) -> None:
        if not 0.0 <= self.q <= 1.0 or self.trials < 0:
            raise ShapeError(f"training: q = {self.q} of {self.trials} trials given; expected q in [0, 1], trials ≥ 0")


@dataclass(frozen=True)
class Round:
    """One round of training, explained.

    Attributes:
        mode, target: the recovery that was trained.
        reason: why the chooser took it.
        q_before: its best success rate until then.
        q_upper: upper confidence limit of its success rate after the round; NaN if the chooser computes none.
        predicted: value of failures if the limit were reached; NaN likewise.
        q: success rate that was measured after the training.
        trials: held-out failures behind `q`.
        solved: the query found a recovery.
        value: value of failures after the round.
    """

    mode: int
    target: int
    reason: str
    q_before: float
    q_upper: float
    predicted: float
    q: float
    trials: int
    solved: bool
    value: float

    @property
    def q_after(self) -> float:
        """The best success rate so far; training cannot lower it, since the better policy is kept (Algorithm 3)."""
        return max(self.q, self.q_before)


_COLUMNS = {each.name: each.type for each in dataclasses.fields(Round)}
_KINDS = {"int": np.int64, "float": np.float64, "bool": np.bool_, "str": np.str_}


@dataclass(frozen=True)
class History:
    """All rounds so far.

    Attributes:
        initial: [I, M] success rates before any training.
        rounds: T of them, oldest first.
        generator: state of the chooser's random generator after the last round, as JSON; empty before the first.

    Example:
        >>> import numpy as np
        >>> from p2l import History
        >>> history = History(np.zeros((2, 3)))  # two modes, three targets, nothing trained
        >>> len(history), history.counts.tolist()
        (0, [[0, 0, 0], [0, 0, 0]])
    """

    initial: Array
    rounds: tuple[Round, ...] = field(default=())
    generator: str = ""

    def __post_init__(self) -> None:
        initial = freeze("initial", self.initial, ("I", "M"), {}, low=0.0, high=1.0)
        object.__setattr__(self, "initial", initial)
        _ = self.best  # computing it checks the rounds

    def __len__(self) -> int:
        return len(self.rounds)

    @cached_property
    def best(self) -> Array:
        """[I, M] best success rate of each recovery so far."""
        best = self.initial.copy()
        for number, each in enumerate(self.rounds, start=1):
            pair = each.mode, each.target
            if not (0 <= each.mode < len(best) and 0 <= each.target < best.shape[1]):
                raise ShapeError(f"round {number}: recovery {pair} is none of the {best.shape[0]} × {best.shape[1]}")
            if not 0.0 <= each.q <= 1.0 or each.q_before != best[pair]:
                raise ShapeError(
                    f"round {number}: recovery {pair} goes from {each.q_before} to {each.q}; "
                    f"expected a start at {best[pair]}, its best so far, and an end in [0, 1]"
                )
            best[pair] = each.q_after
        best.setflags(write=False)
        return best

    @cached_property
    def pairs(self) -> IntArray:
        """[T] number `i · M + j` of the recovery that each round trained."""
        width = self.initial.shape[1]
        return np.array([each.mode * width + each.target for each in self.rounds], dtype=np.int64)

    @cached_property
    def counts(self) -> IntArray:
        """[I, M] rounds of training of each recovery."""
        return np.bincount(self.pairs, minlength=self.initial.size).reshape(self.initial.shape)

    @cached_property
    def values(self) -> Array:
        """[T] value of failures after each round."""
        return np.array([each.value for each in self.rounds], dtype=np.float64)

    def last_differences(self, window: int) -> Array:
        """[I, M, W] the last W forward differences of each recovery's best success rate, newest first, else NaN.

        The first is taken from `initial`, so that a recovery trained twice has two (see `improvement`, reading 2).
        """
        out = np.full((self.initial.size, window), np.nan)
        gains = np.array([each.q_after - each.q_before for each in self.rounds])
        order = np.argsort(self.pairs, kind="stable")[::-1]  # within a recovery, newest first
        pairs = self.pairs[order]
        starts = np.searchsorted(-pairs, -pairs)  # position at which each recovery's rounds begin
        age = np.arange(len(pairs)) - starts
        recent = age < window
        out[pairs[recent], age[recent]] = gains[order][recent]
        return out.reshape(*self.initial.shape, window)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """The record as named arrays, one per column of the rounds, for `artifacts.save_arrays`."""
        columns = {
            name: np.array([getattr(each, name) for each in self.rounds], dtype=_KINDS[str(kind)])
            for name, kind in _COLUMNS.items()
        }
        return {"initial": self.initial, "generator": np.array(self.generator), **columns}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> History:
        """Rebuild the record; the constructor checks it."""
        columns = [arrays[name].tolist() for name in _COLUMNS]
        rounds = tuple(Round(*cells) for cells in zip(*columns, strict=True))
        return cls(arrays["initial"], rounds, str(arrays["generator"]))


def table(history: History, targets: Sequence[str] | None = None) -> list[dict[str, Any]]:
    """One row per round: the recovery and the reason for it, the prediction and the outcome.

    Args:
        history: the rounds.
        targets: M names of the preconditions, the goal last.
    """
    rows = []
    for number, each in enumerate(history.rounds, start=1):
        row = {"round": number, **dataclasses.asdict(each), "q_after": each.q_after}
        rows.append(row if targets is None else {**row, "target_name": targets[each.target]})
    return rows


def hopeless(history: History) -> IntArray:
    """The modes all of whose recoveries were trained and never succeeded: their value stays at −c_fail."""
    return np.flatnonzero((history.counts > 0).all(axis=1) & (history.best == 0.0).all(axis=1))

"""Every query, solved or not, with its answer: the memory of recovery training.

An entry is a function of the seed, the recovery and how often that was trained before, whoever asks. Training that was
interrupted therefore goes on from its last entry, to the bit, and two choosers that train the same recovery as often
find the same entries.

Axis letters: T entries, U updates of a query, V of them moved its search distribution, P parameters.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from p2l.artifacts import AnyArray, load_arrays, save_arrays
from p2l.errors import ArtifactError
from p2l.records import Array, freeze
from p2l.skills.relative import SIZE

log = logging.getLogger(__name__)
SCHEMA, VERSION = "recovery_ledger", 2
Key = tuple[int, int, int]
_NUMBERS = ("failure", "solved", "rollouts", "q", "trials", "seconds")


@dataclass(frozen=True)
class Entry:
    """One training of one recovery.

    Attributes:
        failure: index of the training failure that was queried.
        solved: the query found a recovery from there.
        parameters: [P] its answer; of an unsolved query the last mean, which no skill uses.
        success: [U] share of rollouts that reached the target, by update.
        kl_nats: [V] by how much the search distribution was moved, KL(new ‖ old).
        rollouts: how many were run.
        q: success rate of the recovery skill on held-out failures, with this entry.
        trials: how many of them there are.
        seconds: wall time, which is no part of the result.
    """

    failure: int
    solved: bool
    parameters: Array
    success: Array
    kl_nats: Array
    rollouts: int
    q: float
    trials: int
    seconds: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", freeze("parameters", self.parameters, (SIZE,), {}))
        object.__setattr__(self, "success", freeze("success", self.success, ("U",), {}, low=0.0, high=1.0))
        object.__setattr__(self, "kl_nats", freeze("kl_nats", self.kl_nats, ("V",), {}))


@dataclass
class Ledger:
    """Entries by (mode, target, how often that recovery was trained before).

    Attributes:
        identity: hash of everything that entries are a function of, besides their keys.
        path: where they are kept after every entry; None keeps them in memory.
        entries: all so far.
    """

    identity: str
    path: Path | None = None
    entries: dict[Key, Entry] = field(default_factory=dict)

    @classmethod
    def open(cls, path: Path, identity: str) -> Ledger:
        """The ledger at `path`, empty where there is none.

        Where another training's is there, or a damaged one, it stays, and the new one has its identity in its name.
        """
        own = path.with_name(f"{path.stem}-{identity}{path.suffix}")
        for file in (path, own):
            if not file.is_file():
                return cls(identity, file)
            try:
                arrays = load_arrays(file, schema=SCHEMA, version=VERSION)
            except ArtifactError as error:
                log.warning("%s; training begins anew, beside it", error)
                continue
            if str(arrays["identity"]) == identity:
                return cls(identity, file, _entries(arrays))
            log.warning("%s: is of other failures, preconditions, settings or another seed; it stays", file)
        return cls(identity, own)

    def add(self, key: Key, entry: Entry) -> None:
        """Keep an entry; on disk before this returns."""
        self.entries[key] = entry
        if self.path is not None:
            save_arrays(self.path, self.arrays(), schema=SCHEMA, version=VERSION)

    def of(self, mode: int, target: int, before: int) -> list[Entry]:
        """The first `before` trainings of one recovery, in order."""
        return [self.entries[mode, target, number] for number in range(before)]

    def arrays(self) -> dict[str, AnyArray]:
        """All entries, one row each."""
        entries = list(self.entries.values())
        keys = np.array(list(self.entries), dtype=np.int64).reshape(len(entries), 3)
        parameters = np.array([entry.parameters for entry in entries]).reshape(len(entries), SIZE)
        numbers = {name: np.array([getattr(entry, name) for entry in entries]) for name in _NUMBERS}
        return {
            "identity": np.array(self.identity),
            "keys": keys,
            "parameters": parameters,
            "success": _padded([entry.success for entry in entries]),
            "kl_nats": _padded([entry.kl_nats for entry in entries]),
            **numbers,
        }


def _padded(curves: Sequence[Array]) -> Array:
    """Curves of unlike length as rows, NaN behind each."""
    table = np.full((len(curves), max((len(curve) for curve in curves), default=0)), np.nan)
    for row, curve in zip(table, curves, strict=True):
        row[: len(curve)] = curve
    return table


def _entries(arrays: Mapping[str, AnyArray]) -> dict[Key, Entry]:
    entries: dict[Key, Entry] = {}
    for row, (mode, target, number) in enumerate(arrays["keys"].tolist()):
        success, moved = arrays["success"][row], arrays["kl_nats"][row]
        entries[mode, target, number] = Entry(
            failure=int(arrays["failure"][row]),
            solved=bool(arrays["solved"][row]),
            parameters=arrays["parameters"][row],
            success=success[np.isfinite(success)],
            kl_nats=moved[np.isfinite(moved)],
            rollouts=int(arrays["rollouts"][row]),
            q=float(arrays["q"][row]),
            trials=int(arrays["trials"][row]),
            seconds=float(arrays["seconds"][row]),
        )
    return entries

"""Finished runs of learning among the records (`p2l.ledger`): curves in a record, the policy in a folder beside it.

A run at thesis scale is one item of sixty. Whoever holds the records needs to learn nothing again, and goes on with
the first run that is missing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from p2l.artifacts import atomic, config_hash
from p2l.chaining.agent import PRECONDITIONS
from p2l.chaining.checkpoint import Progress
from p2l.chaining.policy import FILE, load_policy
from p2l.chaining.train import summary
from p2l.errors import ArtifactError
from p2l.failures.record import Failures
from p2l.ledger import Item, find, write

VERSION = 3  # raise it when an edit of the code changes what is learnt: committed records know no code
POLICIES = "policies"
DIGITS = 6  # of the numbers in a record


@dataclass(frozen=True)
class Learnt:
    """A finished run.

    Attributes:
        rounds: one row per rollout.
        evaluations: one row per evaluation.
        facts: the run in plain numbers, see `train.summary`.
    """

    rounds: pd.DataFrame
    evaluations: pd.DataFrame
    facts: Mapping[str, Any]


def learnt_of(progress: Progress, failures: int, apart: int) -> Learnt:
    """What a finished run leaves beside its policy.

    Args:
        progress: the run.
        failures: that there were,
        apart: of them set apart for evaluations.
    """
    facts = {"failures": failures, "set_apart": apart, **summary(progress)}
    return Learnt(pd.DataFrame(progress.rounds), pd.DataFrame(progress.evaluations), facts)


def run_item(item: str, learner: str, seed: int, config: str, failures: Failures, code: str) -> Item:
    """A run's entry in the ledger.

    Args:
        item: world, or a variant of it.
        learner: registered name.
        seed: of the run.
        config: hash of its configuration.
        failures: it learns from.
        code: hash of code whose change makes a record invalid; empty, for committed records: no change does. These go
            to other machines, where the same discovery finds the same failures, but for the last bits of some that
            another processor rounds otherwise; so they know them by their origin, and not by their rows.
    """
    if code:
        known: dict[str, Any] = {name: values.tolist() for name, values in failures.rows.arrays().items()}
    else:
        known = asdict(failures.origin)
        known["params"] = {name: value for name, value in known["params"].items() if name != "nthread"}
    return Item(item, learner, seed, 0, config_hash([VERSION, config, failures.origin.digest, known, code]))


def policy_folder(records: Path, item: Item) -> Path:
    """Where the records hold a run's policy."""
    return records / POLICIES / f"{item.world}-{item.method}-s{item.seed}"


def find_run(records: Path, item: Item, config: str, folder: Path) -> Learnt | None:
    """A finished run of the records, its policy copied to `folder`; None if it is not there, or not whole."""
    known, kept = find(records, item), policy_folder(records, item)
    if known is None:
        return None
    try:
        policy = load_policy(kept)
    except ArtifactError:
        return None
    if policy.card.config_hash != config:
        return None
    copy_policy(kept, folder)
    return Learnt(pd.DataFrame(known["rounds"]), pd.DataFrame(known["evaluations"]), known["facts"])


def keep_run(records: Path, item: Item, learnt: Learnt, folder: Path) -> None:
    """Put a finished run, whose policy is in `folder`, among the records."""
    copy_policy(folder, policy_folder(records, item))
    tables = {"rounds": learnt.rounds, "evaluations": learnt.evaluations}
    content = {name: {str(key): _short(column) for key, column in table.items()} for name, table in tables.items()}
    write(records, item, {**content, "facts": dict(learnt.facts)}, seconds=float(learnt.facts["seconds"]))


def copy_policy(source: Path, target: Path) -> None:
    """A policy, its card and what its learner wants beside it."""
    for name in (FILE, f"{FILE}.json", PRECONDITIONS):
        if (source / name).is_file():
            with atomic(target / name) as temporary:
                temporary.write_bytes((source / name).read_bytes())


def _short(column: pd.Series) -> list[Any]:
    return [round(value, DIGITS) if isinstance(value, float) else value for value in column.tolist()]

"""Finished runs of learning among the records (`p2l.ledger`): curves in a record, the policy in a folder beside it.

A run at thesis scale is one item of sixty. Whoever holds the records needs to learn nothing again, and goes on with
the first run that is missing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from p2l.artifacts import atomic, config_hash
from p2l.chaining.agent import PRECONDITIONS
from p2l.chaining.checkpoint import Progress
from p2l.chaining.policy import ABSENT, FILE, load_policy, policy_hash, save_absent
from p2l.chaining.train import summary, times
from p2l.errors import ArtifactError
from p2l.failures.record import Failures
from p2l.ledger import Item, find, write

VERSION = 3  # raise it when an edit of the code changes what is learnt: committed records know no code
POLICIES = "policies"
DIGITS = 6  # of the numbers in a record
TIMES = ["seconds", "evaluation_seconds", "control_steps_per_s"]  # earlier records hold them; no table does


@dataclass(frozen=True)
class Learnt:
    """A finished run.

    Attributes:
        rounds: one row per rollout.
        evaluations: one row per evaluation.
        facts: the run in plain numbers, see `train.summary`.
        times: what it took, see `train.times`; empty where the records knew it.
    """

    rounds: pd.DataFrame
    evaluations: pd.DataFrame
    facts: Mapping[str, Any]
    times: Mapping[str, float] = field(default_factory=dict)


def learnt_of(progress: Progress, failures: int, apart: int) -> Learnt:
    """What a finished run leaves beside its policy.

    Args:
        progress: the run.
        failures: that there were,
        apart: of them set apart for evaluations.
    """
    facts = {"failures": failures, "set_apart": apart, **summary(progress)}
    return Learnt(pd.DataFrame(progress.rounds), pd.DataFrame(progress.evaluations), facts, times(progress))


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
    """A finished run of the records, its policy copied to `folder`; None if it is not there, or not whole.

    The records may hold a policy's card without its weights: that is enough to look up all that it was judged by.
    """
    content, kept = find(records, item), policy_folder(records, item)
    if content is None:
        return None
    try:
        policy = load_policy(kept, identity=content.get("policy"))
    except ArtifactError:
        return None
    if policy.card.config_hash != config:
        return None
    copy_policy(kept, folder)
    if not policy.weights:
        save_absent(folder, policy)
    rounds, evaluations = (
        pd.DataFrame(content[name]).drop(columns=TIMES, errors="ignore") for name in ("rounds", "evaluations")
    )
    return Learnt(rounds, evaluations, {name: value for name, value in content["facts"].items() if name not in TIMES})


def keep_run(records: Path, item: Item, learnt: Learnt, folder: Path) -> None:
    """Put a finished run, whose policy is in `folder`, among the records."""
    copy_policy(folder, policy_folder(records, item))
    tables = {"rounds": learnt.rounds, "evaluations": learnt.evaluations}
    content = {name: {str(key): _short(column) for key, column in table.items()} for name, table in tables.items()}
    identity = policy_hash(load_policy(folder))
    facts = {"facts": dict(learnt.facts), "policy": identity}
    write(records, item, content | facts, seconds=float(learnt.times["seconds"]))


def copy_policy(source: Path, target: Path) -> None:
    """A policy, its card and what its learner wants beside it, in place of what was there."""
    for name in (FILE, f"{FILE}.json", ABSENT, PRECONDITIONS):
        if (source / name).is_file():
            with atomic(target / name) as temporary:
                temporary.write_bytes((source / name).read_bytes())
        else:  # an earlier policy's
            (target / name).unlink(missing_ok=True)


def _short(column: pd.Series) -> list[Any]:
    return [round(value, DIGITS) if isinstance(value, float) else value for value in column.tolist()]

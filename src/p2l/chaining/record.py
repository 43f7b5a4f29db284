"""Completed training runs in the ledger (`p2l.ledger`): curves in a record, the policy in a folder beside it.

A run at thesis scale is one item of sixty. With the records nothing is trained again, and a comparison continues with
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
from p2l.chaining.search.macros import MACROS
from p2l.chaining.train import summary, times
from p2l.errors import ArtifactError
from p2l.failures.record import Failures
from p2l.ledger import Item, find, place, write

VERSION = 3  # raise it when an edit of the code changes results: committed records hold no hash of the code
VERSIONS = {"search": 5, "search_mixed": 6}  # of learners, by name or registered name, whose code has changed since
POLICIES = "policies"
DIGITS = 6  # of the numbers in a record
TIMES = ["seconds", "evaluation_seconds", "control_steps_per_s"]  # earlier records hold them; no table does


@dataclass(frozen=True)
class RunResult:
    """Result of a completed training run.

    Attributes:
        rounds: one row per rollout.
        evaluations: one row per evaluation.
        facts: summary numbers, see `train.summary`.
        times: wall times, see `train.times`; empty where the result comes from the ledger.
    """

    rounds: pd.DataFrame
    evaluations: pd.DataFrame
    facts: Mapping[str, Any]
    times: Mapping[str, float] = field(default_factory=dict)


def run_result(progress: Progress, failures: int, apart: int, told: Mapping[str, float]) -> RunResult:
    """The result of a completed run, without its policy.

    Args:
        progress: of the run.
        failures: number of recorded failures.
        apart: how many of them were set apart for evaluations.
        told: by the learner, see `learner.Learner`.
    """
    facts = {"failures": failures, "set_apart": apart, **summary(progress), **told, **progress.told}
    return RunResult(pd.DataFrame(progress.rounds), pd.DataFrame(progress.evaluations), facts, times(progress))


def run_item(
    item: str, learner: str, seed: int, config: str, failures: Failures, code: str, *, registered: str = ""
) -> Item:
    """The ledger's item of a run.

    Args:
        item: world, or a variant of it.
        learner: its name among those that are compared.
        seed: of the run.
        config: hash of its configuration.
        failures: to learn from.
        code: hash of the code, whose change makes a record invalid; empty for committed records. These go to other
            machines, where the same discovery finds the same failures, but for the last bits of some that another
            processor rounds otherwise; so their item depends on the origin of the failures, and not on their rows.
        registered: name of the learner.
    """
    if code:
        identity: dict[str, Any] = {name: values.tolist() for name, values in failures.rows.arrays().items()}
    else:
        identity = asdict(failures.origin)
        identity["params"] = {name: value for name, value in identity["params"].items() if name != "nthread"}
    version = VERSIONS.get(learner, VERSIONS.get(registered, VERSION))
    return Item(item, learner, seed, 0, config_hash([version, config, failures.origin.digest, identity, code]))


def policy_folder(records: Path, item: Item) -> Path:
    """Folder of a run's policy among the records."""
    own = place(records, item).removeprefix(item.file.removesuffix(".json")).removesuffix(".json")
    return records / POLICIES / f"{item.world}-{item.method}-s{item.seed}{own}"


def find_run(records: Path, item: Item, config: str, folder: Path) -> RunResult | None:
    """The result of a run in the ledger, its policy copied to `folder`; None if it is missing or incomplete.

    The records may hold a policy's card without its weights, which is enough to look up its evaluations.
    """
    content, source = find(records, item), policy_folder(records, item)
    if content is None:
        return None
    try:
        policy = load_policy(source, identity=content.get("policy"))
    except ArtifactError:
        return None
    if policy.card.config_hash != config:
        return None
    copy_policy(source, folder)
    if not policy.weights:
        save_absent(folder, policy)
    rounds, evaluations = (
        pd.DataFrame(content[name]).drop(columns=TIMES, errors="ignore") for name in ("rounds", "evaluations")
    )
    return RunResult(
        rounds, evaluations, {name: value for name, value in content["facts"].items() if name not in TIMES}
    )


def keep_run(records: Path, item: Item, result: RunResult, folder: Path) -> None:
    """Write the result of a run, and its policy from `folder`, to the ledger."""
    copy_policy(folder, policy_folder(records, item))
    tables = {"rounds": result.rounds, "evaluations": result.evaluations}
    content = {name: {str(key): _short(column) for key, column in table.items()} for name, table in tables.items()}
    identity = policy_hash(load_policy(folder))
    facts = {"facts": dict(result.facts), "policy": identity}
    write(records, item, content | facts, seconds=float(result.times["seconds"]))


def copy_policy(source: Path, target: Path) -> None:
    """Copy a policy with its card, its preconditions and its macros, and delete those of an earlier policy."""
    for name in (FILE, f"{FILE}.json", ABSENT, PRECONDITIONS, MACROS):
        if (source / name).is_file():
            with atomic(target / name) as temporary:
                temporary.write_bytes((source / name).read_bytes())
        else:  # an earlier policy's
            (target / name).unlink(missing_ok=True)


def _short(column: pd.Series) -> list[Any]:
    return [round(value, DIGITS) if isinstance(value, float) else value for value in column.tolist()]

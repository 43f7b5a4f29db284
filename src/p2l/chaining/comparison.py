"""Every learner with every seed, or one of them alone: prepared, looked up among the records, learnt, recorded.

What one of the runs refuses is refused before any of them learns. Runs go seed by seed, so that an interruption leaves
whole comparisons.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import pandas as pd

from p2l.chaining.checkpoint import drop_checkpoint
from p2l.chaining.learner import ChainTask, Learner
from p2l.chaining.learners.table import make_learner
from p2l.chaining.mdp import Limits
from p2l.chaining.record import Learnt, copy_policy, find_run, keep_run, learnt_of, run_item
from p2l.chaining.train import FailureSplit, TrainSettings, apart_of, card_of, split, train
from p2l.failures.record import Failures, open_world
from p2l.ledger import Item


class Observer(Protocol):
    """Who is told of a run while it learns."""

    def row(self, kind: str, row: Mapping[str, float]) -> None:
        """A `round`, an `evaluation`, or `resumed` with a checkpoint's control steps, see `train.train`."""

    def note(self, text: str) -> None:
        """Something a person should know about the run."""


@dataclass(frozen=True)
class ChainRun:
    """One run, and all that decides it.

    Attributes:
        item: world, or a variant of it.
        name: the learner's in tables and folders.
        learner: its registered name, or its target.
        params: of the learner.
        seed: of the run.
        config_hash: of its configuration.
        settings: budget and rhythm.
        limits: bounds of an episode.
        narrowest: see `policy.Normalisation`.
        nthread: simulator threads, which change no result; None: as many as found the failures.
    """

    item: str
    name: str
    learner: str
    params: Mapping[str, Any]
    seed: int
    config_hash: str
    settings: TrainSettings
    limits: Limits
    narrowest: float
    nthread: int | None = None


@dataclass(frozen=True)
class PreparedRun:
    """A run that nothing refuses."""

    run: ChainRun
    failures: int
    parts: FailureSplit
    task: ChainTask
    learner: Learner


Observed = Callable[[ChainRun, Path], AbstractContextManager[Observer]]
RunKey = tuple[str, int]  # name of the learner, seed


def prepare(run: ChainRun, failures: Failures, path: Path) -> PreparedRun:
    """Check all that can be refused about a run.

    Args:
        run: what is asked for.
        failures: to learn from.
        path: where they lie, for messages.

    Raises:
        ArtifactError: failures of another world.
        ConfigError: unknown learner, or a setting that it or the world refuses.
    """
    world, nominal = open_world(failures, path, run.nthread)
    parts = split(failures.rows, run.settings.episodes, run.seed, world.name)
    task = ChainTask(world, nominal, parts.learnt, run.seed)
    learner = make_learner(run.learner, task, run.limits, run.params)
    return PreparedRun(run, len(failures), parts, task, learner)


def learn(prepared: PreparedRun, out: Path, observer: Observer) -> Learnt:
    """Train one run; its policy, and as long as it is under way its checkpoint, are in `out`."""
    run, parts, task, learner = prepared.run, prepared.parts, prepared.task, prepared.learner
    card = card_of(task, learner, run.name, run.config_hash, run.narrowest)
    if parts.shared and not learner.whole_task:
        episodes = run.settings.episodes
        observer.note(
            f"{prepared.failures} failures are too few to set {episodes} apart: evaluations start at all of them."
        )
    apart = apart_of(task, learner, parts, run.settings.episodes)
    progress = train(task, learner, apart, run.settings, card, out, observer.row)
    return learnt_of(progress, prepared.failures, parts.set_apart)


def policies(out: Path, key: RunKey) -> Path:
    """Where a comparison keeps a run's policy."""
    name, seed = key
    return out / "policies" / name / f"s{seed}"


def compare(
    runs: Sequence[ChainRun],
    failures: Failures,
    path: Path,
    out: Path,
    records: Path,
    code: str,
    observed: Observed,
    finished: Callable[[RunKey, Learnt], None],
) -> dict[RunKey, Learnt]:
    """All runs, in order; those among the records are not learnt again.

    Args:
        runs: what is asked for.
        failures: to learn from.
        path: where they lie, for messages.
        out: policies go to `policies`, runs under way to runs/s<seed>/<learner>/<hash>.
        records: folder of the ledger.
        code: see `record.run_item`.
        observed: opens the observer of a run that is learnt, in a folder of its own.
        finished: told of every run, once.
    """
    results: dict[RunKey, Learnt] = {}
    missing: list[tuple[ChainRun, Item]] = []
    for run in runs:
        key = run.name, run.seed
        item = run_item(run.item, run.name, run.seed, run.config_hash, failures, code)
        if (learnt := find_run(records, item, run.config_hash, policies(out, key))) is None:
            missing.append((run, item))
        else:
            finished(key, learnt)
            results[key] = learnt
    # Between a learner's runs only the seed differs, so that the first one's preparation stands for all.
    firsts = {run.name: run for run, _ in reversed(missing)}
    prepared = {run.name: prepare(run, failures, path) for run in firsts.values()}
    for run, item in missing:
        key, place = (run.name, run.seed), out / "runs" / f"s{run.seed}" / run.name
        # Another machine, or another clone, may have learnt it meanwhile, beside this one.
        learnt = find_run(records, item, run.config_hash, policies(out, key))
        if learnt is None:
            mine = prepared.pop(run.name) if firsts[run.name] is run else prepare(run, failures, path)
            with observed(run, place) as observer:
                learnt = learn(mine, place / item.config_hash, observer)
            keep_run(records, item, learnt, place / item.config_hash)
            copy_policy(place / item.config_hash, policies(out, key))
            drop_checkpoint(place / item.config_hash)
        finished(key, learnt)
        results[key] = learnt
    return {(run.name, run.seed): results[run.name, run.seed] for run in runs}


def curves(results: Mapping[RunKey, Learnt]) -> dict[str, pd.DataFrame]:
    """Rounds and evaluations of all runs, with columns `learner` and `seed`."""
    return {
        kind: pd.concat(
            [getattr(learnt, kind).assign(learner=name, seed=seed) for (name, seed), learnt in results.items()]
        )
        for kind in ("rounds", "evaluations")
    }

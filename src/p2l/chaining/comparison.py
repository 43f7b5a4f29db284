"""Training runs of every learner with every seed, or of one alone: set up, looked up in the ledger, trained, recorded.

Invalid runs are refused before any of them trains. Runs go seed by seed, so that an interruption leaves whole
comparisons.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import pandas as pd

from p2l.chaining.checkpoint import drop_checkpoint
from p2l.chaining.learner import ChainTask, Learner
from p2l.chaining.learners.table import make_learner
from p2l.chaining.mdp import Limits
from p2l.chaining.record import RunResult, copy_policy, find_run, keep_run, run_item, run_result
from p2l.chaining.train import FailureSplit, TrainSettings, card_of, evaluation_starts_of, split, train
from p2l.errors import ConfigError
from p2l.failures.record import Failures, open_world, varied_world
from p2l.ledger import Item


class Observer(Protocol):
    """Receives the progress of a run."""

    def row(self, kind: str, row: Mapping[str, float]) -> None:
        """A row of kind `round`, `evaluation` or `resumed`, see `train.train`."""

    def note(self, text: str) -> None:
        """A remark for the user."""


@dataclass(frozen=True)
class ChainRun:
    """One training run and all that determines it.

    Attributes:
        item: world, or a variant of it.
        name: of the learner in tables and folders.
        learner: its registered name, or its target.
        params: of the learner.
        seed: of the run.
        config_hash: of its configuration.
        settings: budget and rhythm.
        limits: bounds of an episode.
        narrowest: see `policy.Normalisation`.
        nthread: simulator threads, which change no result; None: as many as in the discovery of the failures.
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
class RunSetup:
    """A valid run, ready to train.

    Attributes:
        run: its settings.
        failures: how many were recorded.
        parts: the failures, split.
        task: what to learn.
        learner: how.
    """

    run: ChainRun
    failures: int
    parts: FailureSplit
    task: ChainTask
    learner: Learner


OpenObserver = Callable[[ChainRun, Path], AbstractContextManager[Observer]]
RunKey = tuple[str, int]  # name of the learner, seed


def prepare(run: ChainRun, failures: Failures, path: Path) -> RunSetup:
    """Set up a run, and refuse an invalid one.

    Args:
        run: its settings.
        failures: to learn from.
        path: of their file, for messages.

    Raises:
        ArtifactError: failures of another world.
        ConfigError: unknown learner, or a setting that it or the world refuses, a budget of no round, or a field
            that the world does not observe.
    """
    world, nominal = open_world(failures, path, run.nthread)
    parts = split(failures.rows, run.settings.episodes, run.seed, world.name)
    fields = world.observe(failures.rows.take([0])).columns
    if missing := [name for name in run.limits.fields if name not in fields]:
        raise ConfigError(
            f"limits.fields names {', '.join(missing)}, which world '{world.name}' with these parameters does not "
            f"observe; it observes: {', '.join(fields)}"
        )
    task = ChainTask(world, nominal, parts.training, run.seed, partial(varied_world, failures, run.nthread))
    learner = make_learner(run.learner, task, run.limits, run.params)
    if learner.search is None:
        run.settings.check_rounds()
    return RunSetup(run, len(failures), parts, task, learner)


def learn(setup: RunSetup, out: Path, observer: Observer) -> RunResult:
    """Train one run; `out` holds its policy and, until it completes, its checkpoint."""
    run, parts, task, learner = setup.run, setup.parts, setup.task, setup.learner
    card = card_of(task, learner, run.name, run.config_hash, run.narrowest)
    if parts.overlap and not learner.whole_task:
        episodes = run.settings.episodes
        observer.note(
            f"{setup.failures} failures are too few to set {episodes} apart: evaluations start at all of them."
        )
    evaluation_starts = evaluation_starts_of(task, learner, parts, run.settings.episodes)
    if learner.search is None:
        progress = train(task, learner, evaluation_starts, run.settings, card, out, observer.row)
    else:
        from p2l.chaining.search.train import search_train  # the others need no forest

        plan = learner.search
        progress = search_train(task, learner, plan, evaluation_starts, run.settings, card, out, observer.row)
    return run_result(progress, setup.failures, parts.set_apart, learner.told)


def policies(out: Path, key: RunKey) -> Path:
    """Folder of a run's policy in a comparison."""
    name, seed = key
    return out / "policies" / name / f"s{seed}"


def compare(
    runs: Sequence[ChainRun],
    failures: Failures,
    path: Path,
    out: Path,
    records: Path,
    code: str,
    open_observer: OpenObserver,
    report: Callable[[RunKey, RunResult], None],
) -> dict[RunKey, RunResult]:
    """Results of all runs, in order; runs found in the ledger are not trained again.

    Args:
        runs: their settings.
        failures: to learn from.
        path: of their file, for messages.
        out: policies go to `policies`, unfinished runs to runs/s<seed>/<learner>/<hash>.
        records: folder of the ledger.
        code: see `record.run_item`.
        open_observer: opens the observer of a run that trains, in a folder of its own.
        report: called once for each run, with its result.
    """
    results: dict[RunKey, RunResult] = {}
    missing: list[tuple[ChainRun, Item]] = []
    for run in runs:
        key = run.name, run.seed
        item = run_item(run.item, run.name, run.seed, run.config_hash, failures, code, registered=run.learner)
        if (result := find_run(records, item, run.config_hash, policies(out, key))) is None:
            missing.append((run, item))
        else:
            report(key, result)
            results[key] = result
    # Between a learner's runs only the seed differs, so that the first one's setup checks all.
    firsts = {run.name: run for run, _ in reversed(missing)}
    setups = {run.name: prepare(run, failures, path) for run in firsts.values()}
    for run, item in missing:
        key, place = (run.name, run.seed), out / "runs" / f"s{run.seed}" / run.name
        # Another machine, or another clone, may have recorded it meanwhile.
        result = find_run(records, item, run.config_hash, policies(out, key))
        if result is None:
            mine = setups.pop(run.name) if firsts[run.name] is run else prepare(run, failures, path)
            with open_observer(run, place) as observer:
                result = learn(mine, place / item.config_hash, observer)
            keep_run(records, item, result, place / item.config_hash)
            copy_policy(place / item.config_hash, policies(out, key))
            drop_checkpoint(place / item.config_hash)
        report(key, result)
        results[key] = result
    return {(run.name, run.seed): results[run.name, run.seed] for run in runs}


def curves(results: Mapping[RunKey, RunResult]) -> dict[str, pd.DataFrame]:
    """Rounds and evaluations of all runs, with columns `learner` and `seed`."""
    return {
        kind: pd.concat(
            [getattr(result, kind).assign(learner=name, seed=seed) for (name, seed), result in results.items()]
        )
        for kind in ("rounds", "evaluations")
    }

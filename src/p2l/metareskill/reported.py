"""The value of failures on failures that nobody chose by: a third split, for what is reported.

A success rate that drives a chooser is measured on held-out failures, and of several trainings the best is kept
(Algorithm 3): the largest of several measurements is too large on average, and more so for a chooser that goes where a
measurement was large. So what is reported of a training is measured again: after every round the skills that were kept
then, on failures of another seed that neither training nor choosing has met.

Axis letters: T rounds, I modes, M targets.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from p2l.artifacts import config_hash
from p2l.errors import ConfigError
from p2l.failures.discovery import find_failures
from p2l.failures.record import Failures
from p2l.ledger import Item, find, write
from p2l.metareskill.chooser_run import record_history
from p2l.metareskill.graph import SkillGraph
from p2l.metareskill.history import History
from p2l.metareskill.members import Members
from p2l.metareskill.setting import Setting, members
from p2l.metareskill.trainer import Trainer
from p2l.metareskill.value_iteration import value_of_failures
from p2l.records import Array
from p2l.seeding import generator

SPLIT, VERSION = "reported", 2  # raise it when an edit of the code measures otherwise: committed records know no code


@dataclass(frozen=True)
class ReportedSplit:
    """The third split: failures of a seed path of their own, found as the training failures were.

    Attributes:
        setting: world, preconditions and modes.
        train: the training failures.
        executions: episodes that are run.
    """

    setting: Setting
    train: Failures
    executions: int

    @property
    def identity(self) -> str:
        """Hash of all that decides them, besides what the ledger's identity holds."""
        origin = self.train.origin
        return config_hash([VERSION, self.executions, origin.seed, origin.strategy])

    @cached_property
    def failures(self) -> Members:
        """With their modes; found when they are first asked for.

        Raises:
            ConfigError: a mode has no failure among them.
            ArtifactError: there is no failure in which no learnt precondition holds.
        """
        setting, world = self.setting, self.setting.task.world
        starts = world.sample(generator(self.train.origin.seed, "discover", world.name, SPLIT), self.executions)
        origin = replace(self.train.origin, split=SPLIT, executions=self.executions)
        found = find_failures(world, world.nominal_options(), starts, origin).failures
        failures, _ = members(setting.task, found, setting.modes)
        sizes = np.bincount(failures.mode, minlength=len(setting.graph.sizes))
        if empty := np.flatnonzero(sizes == 0).tolist():
            raise ConfigError(
                f"reported={self.executions}: none of these executions ends in failure modes {empty}, so that their "
                "recoveries cannot be reported; give more, or 0 to report what drives the choice"
            )
        return failures


def reported_split(
    setting: Setting, train: Failures, executions: int, records: Path, item: str
) -> ReportedSplit | None:
    """The third split; None for no executions: then what drives the choice is reported, too.

    Where `records` hold no reported values of `item` yet, the failures are found at once, before any training.

    Raises:
        ConfigError, ArtifactError: see `ReportedSplit.failures`.
    """
    if not executions:
        return None
    split = ReportedSplit(setting, train, executions)
    if not any(records.glob(f"{item}-*_{SPLIT}-s*.json")):
        _ = split.failures
    return split


def reported_values(
    trainer: Trainer, graph: SkillGraph, history: History, split: Members, episodes: int = 1
) -> list[float]:
    """[T + 1] value of failures before any round and after each, with the success rates of the kept skills on `split`.

    Args:
        trainer: of one seed; its ledger holds every round.
        graph: before any training.
        history: the rounds.
        split: failures with their modes.
        episodes: trainings in a round.
    """
    judge = replace(trainer, held_out=split)
    counts = np.zeros_like(history.counts)
    q: Array = np.zeros_like(graph.q)
    rates: dict[tuple[int, int, int], float] = {}
    for mode, target in np.argwhere(graph.q > 0.0).tolist():
        guess = trainer.skill(mode, target, 0)
        assert guess is not None  # it works sometimes
        rates[mode, target, 0] = q[mode, target] = judge.measure(guess, mode, target)[0]
    values = [float(value_of_failures(graph, q))]
    for each in history.rounds:
        pair = each.mode, each.target
        counts[pair] += 1
        kept = trainer.kept(*pair, int(counts[pair]) * episodes)
        if kept is not None and (*pair, kept) not in rates:
            skill = trainer.skill(*pair, kept)
            assert skill is not None  # one of its queries was solved
            rates[*pair, kept] = judge.measure(skill, *pair)[0]
        if kept is not None:
            q[pair] = rates[*pair, kept]
        values.append(float(value_of_failures(graph, q)))
    return values


def keep_history(
    records: Path,
    item: str,
    trainer: Trainer,
    chooser: str,
    graph: SkillGraph,
    history: History,
    split: ReportedSplit | None,
    settings: Mapping[str, Any],
) -> Array:
    """Leave a chooser's rounds among the records; [T + 1] the values to report, from their record or measured.

    Without a split these are the values of the history.

    Args:
        records: folder of the ledger.
        item: what was trained, for the names of the records.
        trainer: of one seed; its ledger holds every round.
        chooser: whose rounds.
        graph: before any training.
        history: the rounds.
        split: failures that nobody chose by.
        settings: of the chooser and of the loop; `episodes`, the trainings of a round, among them.
    """
    record_history(records, item, trainer, chooser, history, settings)
    if split is None:
        return np.append(value_of_failures(graph), history.values)
    identity = config_hash([trainer.ledger.identity, dict(settings), split.identity])
    record = Item(item, f"{chooser}_{SPLIT}", trainer.seed, 0, identity)
    if (content := find(records, record)) is None:
        begin = time.perf_counter()
        values = reported_values(trainer, graph, history, split.failures, int(settings["episodes"]))
        content = {"value": [float(f"{value:.6g}") for value in values]}
        write(records, record, content, seconds=time.perf_counter() - begin)
    return np.array(content["value"])

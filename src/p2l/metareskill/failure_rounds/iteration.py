"""All failure rounds of one seed: train, see success, find what is left, train on.

Episodes are run in a `field`, what is left is found and grouped in `remaining`, and the setting grows in `growth`.

Start states of discovery and of success have seed paths of their own (`p2l.seeding`); nothing else uses them.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from p2l.failures.classifier import save_modes
from p2l.failures.record import SPLITS, Failures, Origin, save_failures
from p2l.metareskill.algorithm import check_budget
from p2l.metareskill.chooser_run import train_recoveries
from p2l.metareskill.choosers.contract import Chooser
from p2l.metareskill.failure_rounds.field import Field, execute
from p2l.metareskill.failure_rounds.growth import extend, extend_graph, extend_history
from p2l.metareskill.failure_rounds.remaining import group, lost
from p2l.metareskill.graph import SkillGraph
from p2l.metareskill.history import History
from p2l.metareskill.ledger import Ledger
from p2l.metareskill.record import Recoveries, collect, save_recoveries
from p2l.metareskill.setting import Setting
from p2l.metareskill.trainer import Trainer
from p2l.seeding import entropy, generator

log = logging.getLogger(__name__)
PATH = "iterate_recoveries"


@dataclass(frozen=True)
class Budget:
    """Numbers of rounds, trainings and episodes.

    Attributes:
        failure_rounds: of learning.
        rounds: of training in each of them.
        episodes: trainings in a round.
        train, held_out: episodes in which new failures are found.
        max_modes: of new failures, each time.
        development: episodes behind a success rate.
    """

    failure_rounds: int
    rounds: int
    episodes: int
    train: int
    held_out: int
    max_modes: int
    development: int

    def check(self, graph: SkillGraph, chooser: Chooser) -> None:
        """Refuse what would not cover the chooser's initial rounds, however many modes are found.

        Raises:
            ConfigError: too few rounds.
        """
        for number in range(self.failure_rounds):
            largest = extend_graph(graph, np.ones(number * self.max_modes))
            check_budget(largest, chooser, (number + 1) * self.rounds, self.episodes)


@dataclass(frozen=True)
class Iteration:
    """One seed.

    Attributes:
        field: where episodes are run.
        chooser: decides which recovery is trained.
        budget: of all rounds.
        origin: of the failures before any learning.
        base: seed of discovery, of success and of grouping.
        seed: of training.
        folder: everything is kept there.
        ledger: of the first round's queries, only read; None: there is none.
        code: see `learn.Setting.trainer`.
        show: called after each round of training.
    """

    field: Field
    chooser: Chooser
    budget: Budget
    origin: Origin
    base: int
    seed: int
    folder: Path
    ledger: Path | None
    code: str
    show: Callable[[int], None]

    def run(self, setting: Setting) -> Iterator[dict[str, Any]]:
        """A row for `recovery_iterations.success_table` before any learning, and one after each failure round."""
        yield self._row(0, setting, None)
        budget, count = self.budget, len(setting.failures.mode)
        trainer: Trainer | None = None
        history: History | None = None
        for number in range(1, budget.failure_rounds + 1):
            trainer = self._trainer(number, setting, trainer)
            history = train_recoveries(
                trainer,
                setting.graph,
                self.chooser,
                rounds=number * budget.rounds,
                episodes=budget.episodes,
                history=None if history is None else extend_history(history, setting),
                report=lambda _: self.show(1),
            )
            recoveries = collect(trainer, setting.modes, setting.graph, history, budget.episodes)
            folder = self.folder / f"round_{number}"
            save_modes(folder / "modes.npz", setting.modes)
            save_recoveries(folder / "recoveries.npz", recoveries)
            yield self._row(number, setting, recoveries, queries=len(history) * budget.episodes, found=count)
            if number < budget.failure_rounds:
                train, held_out = (self._new(number, setting, recoveries, split) for split in SPLITS)
                grouping = entropy(self.base, PATH, "cluster", self.seed, number)
                if (more := group(self.field.task, train, held_out, budget.max_modes, grouping)) is None:
                    log.warning("seed %d: round %d left too few failures; it was the last", self.seed, number)
                    return
                setting, count = extend(setting, train, held_out, more), len(train)

    def _trainer(self, number: int, setting: Setting, before: Trainer | None) -> Trainer:
        """The trainer of a round; its ledger holds the queries of the rounds before."""
        trainer = setting.trainer(self.seed, self.folder / f"round_{number}" / "ledger.npz", self.code)
        if before is not None:
            trainer.ledger.entries = before.ledger.entries | trainer.ledger.entries
        elif self.ledger is not None:
            first = Ledger.open(self.ledger, trainer.ledger.identity)
            trainer.ledger.entries = first.entries | trainer.ledger.entries
        return trainer

    def _row(self, number: int, setting: Setting, recoveries: Recoveries | None, **counts: int) -> dict[str, Any]:
        """Success from the same starts in every round."""
        world = self.field.task.world
        rng = generator(self.base, PATH, world.name, "development", self.seed)
        starts, ties = world.sample(rng, self.budget.development), generator(self.base, PATH, "ties", self.seed)
        execution = execute(
            self.field, "no_recovery" if recoveries is None else "recoveries", starts, setting, recoveries, ties
        )
        row = {"round": number, "seed": self.seed, "queries": 0, "modes": len(setting.modes), "found": 0} | counts
        return row | {"episodes": int((~execution.diverged).sum()), "successes": int(execution.success.sum())}

    def _new(self, number: int, setting: Setting, recoveries: Recoveries, split: str) -> Failures:
        """Failures of episodes with the recoveries in place."""
        path = self.base, PATH, self.field.task.world.name, split, self.seed, number
        starts = self.field.task.world.sample(generator(*path), getattr(self.budget, split))
        execution = execute(self.field, "recoveries", starts, setting, recoveries, generator(*path, "ties"))
        failures = lost(self.field, starts, execution, self.origin, split, self.base)
        save_failures(self.folder / f"round_{number}" / f"failures_{split}.npz", failures)
        return failures

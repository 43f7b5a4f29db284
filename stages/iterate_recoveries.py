"""Stage `iterate_recoveries`: failure rounds, each learning from what the recoveries before it left unsolved."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from p2l.artifacts import atomic, save_json
from p2l.evaluation.recovery_iterations import ALL, success_figure, success_table
from p2l.evaluation.style import png
from p2l.failures.classifier import save_modes
from p2l.failures.record import SPLITS, Failures, Origin, load_failures, save_failures
from p2l.ledger import code_digest
from p2l.recoveries.iterate import Field, continued, execute, extended, group, grown, lost
from p2l.recoveries.learn import Setting, train_recoveries
from p2l.recoveries.ledger import Ledger
from p2l.recoveries.metareskill.choose import Chooser, get_chooser
from p2l.recoveries.metareskill.history import History
from p2l.recoveries.metareskill.loop import check_budget
from p2l.recoveries.record import Recoveries, collect, save_recoveries
from p2l.recoveries.target import Task
from p2l.recoveries.train import Trainer
from p2l.registry import get_options, get_symbols, get_world
from p2l.schema import IterateRecoveriesConfig
from p2l.seeding import entropy, generator
from p2l.tracking import Tracker
from stages._progress import counter
from stages._recovery import open_setting
from stages._stage import stage

log = logging.getLogger(__name__)
PATH = "iterate_recoveries"
IMPROVING = "halving"  # the estimator under which recoveries are evaluated, too


@stage("iterate_recoveries", IterateRecoveriesConfig)
def run(cfg: IterateRecoveriesConfig, out: Path, track: Tracker) -> None:
    """Leave success.csv and success.png, and by seed and round what was found and learnt."""
    told = cfg.choosers[cfg.compare[0]]
    setting, chooser = open_setting(cfg), get_chooser(told.name, told.params)
    for number in range(cfg.failure_rounds):
        largest = grown(setting.graph, np.ones(number * cfg.max_modes))
        check_budget(largest, chooser, (number + 1) * cfg.rounds, cfg.episodes)
    world = get_world(cfg.world.name, {**cfg.world.params, "estimator": IMPROVING})
    task = Task(world, get_symbols(world.name, world), setting.task.preconditions)
    field = Field(task, get_options(world.name, world), cfg.max_options, cfg.slots)
    origin = load_failures(cfg.failures, "train").origin
    rows: list[dict[str, Any]] = []
    with counter(f"iterate {cfg.item}", "round", cfg.failure_rounds * cfg.rounds * len(cfg.seeds)) as show:
        for seed in cfg.seeds:
            rows += _Seed(cfg, field, chooser, origin, seed, out, show).rounds(setting)
    table = success_table(pd.DataFrame(rows))
    with atomic(out / "success.csv") as temporary:
        table.to_csv(temporary, index=False, float_format="%.6g")
    with atomic(out / "success.png") as temporary:
        temporary.write_bytes(png(success_figure(table, f"{cfg.item}: success by failure round")))
    pooled = table[table["seed"] == ALL]
    success = dict(zip((f"success/{n}" for n in pooled["round"]), pooled["success"].tolist(), strict=True))
    save_json(out / "summary.json", {"success": success}, schema="iterate_summary", version=1)
    track.metrics(success)
    for name in ("success.csv", "success.png"):
        track.artifact(out / name)


@dataclass(frozen=True)
class _Seed:
    """All failure rounds of one seed."""

    cfg: IterateRecoveriesConfig
    field: Field
    chooser: Chooser
    origin: Origin
    seed: int
    out: Path
    show: Callable[[int], None]

    def rounds(self, setting: Setting) -> Iterator[dict[str, Any]]:
        """A row of the table before any learning, and one after each round."""
        yield self._row(0, setting, None)
        cfg, found = self.cfg, len(setting.failures.mode)
        trainer: Trainer | None = None
        history: History | None = None
        for number in range(1, cfg.failure_rounds + 1):
            trainer = self._trainer(number, setting, trainer)
            history = train_recoveries(
                trainer,
                setting.graph,
                self.chooser,
                rounds=number * cfg.rounds,
                episodes=cfg.episodes,
                history=None if history is None else continued(history, setting),
                report=lambda _: self.show(1),
            )
            learnt = collect(trainer, setting.modes, setting.graph, history, cfg.episodes)
            folder = self.out / f"s{self.seed}" / f"round_{number}"
            save_modes(folder / "modes.npz", setting.modes)
            save_recoveries(folder / "recoveries.npz", learnt)
            yield self._row(number, setting, learnt, queries=len(history) * cfg.episodes, found=found)
            if number < cfg.failure_rounds:
                train, held_out = (self._new(number, setting, learnt, split, folder) for split in SPLITS)
                grouping = entropy(cfg.seed, PATH, "cluster", self.seed, number)
                if (more := group(self.field.task, train, held_out, cfg.max_modes, grouping)) is None:
                    log.warning("seed %d: round %d left too few failures; it was the last", self.seed, number)
                    return
                setting, found = extended(setting, train, held_out, more), len(train)

    def _trainer(self, number: int, setting: Setting, before: Trainer | None) -> Trainer:
        """Knows what was asked in the rounds before; in the first, what `learn_recoveries` left among the records."""
        code = "" if self.cfg.records else code_digest("sim", "worlds", "skills", "recoveries")
        name = f"{self.cfg.item}-ledger-s{self.seed}"
        trainer = setting.trainer(self.seed, self.out / "records" / f"{name}-r{number}.npz", code)
        if before is not None:
            known = before.ledger
        elif self.cfg.records is not None:
            known = Ledger.open(self.cfg.records / f"{name}.npz", trainer.ledger.identity)
        else:
            return trainer
        trainer.ledger.entries = known.entries | trainer.ledger.entries
        return trainer

    def _row(self, number: int, setting: Setting, learnt: Recoveries | None, **counts: int) -> dict[str, Any]:
        """Success from development starts, the same ones in every round of a seed."""
        cfg, world = self.cfg, self.field.task.world
        starts = world.sample(generator(cfg.seed, PATH, world.name, "development", self.seed), cfg.development)
        strategy, ties = "no_recovery" if learnt is None else "recoveries", generator(cfg.seed, PATH, "ties", self.seed)
        done = execute(self.field, strategy, starts, setting, learnt, ties)
        row = {"round": number, "seed": self.seed, "queries": 0, "modes": len(setting.modes), "found": 0} | counts
        return row | {"episodes": int((~done.diverged).sum()), "successes": int(done.success.sum())}

    def _new(self, number: int, setting: Setting, learnt: Recoveries, split: str, folder: Path) -> Failures:
        """Failures of episodes with the recoveries in place."""
        path = self.cfg.seed, PATH, self.field.task.world.name, split, self.seed, number
        starts = self.field.task.world.sample(generator(*path), getattr(self.cfg.executions, split))
        done = execute(self.field, "recoveries", starts, setting, learnt, generator(*path, "ties"))
        failures = lost(self.field, starts, done, self.origin, split, self.cfg.seed)
        save_failures(folder / f"failures_{split}.npz", failures)
        return failures


if __name__ == "__main__":
    run()

"""Stage `iterate_recoveries`: failure rounds, each learning from what the recoveries before it left unsolved."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd

from p2l.artifacts import atomic, save_json
from p2l.evaluation.metareskill.iterations import ALL, success_figure, success_table
from p2l.evaluation.style import png
from p2l.failures.record import load_failures
from p2l.ledger import RECOVERING, code_digest
from p2l.metareskill.choosers.choose import get_chooser
from p2l.metareskill.rounds.failure_rounds import Budget, Iteration
from p2l.metareskill.rounds.iterate import Field
from p2l.metareskill.target import Task
from p2l.registry import get_options, get_symbols, get_world
from p2l.schema import IterateRecoveriesConfig
from p2l.tracking import Tracker
from stages._progress import counter
from stages._recovery import open_setting
from stages._stage import stage

IMPROVING = "halving"  # the estimator under which recoveries are evaluated, too


@stage("iterate_recoveries", IterateRecoveriesConfig)
def run(cfg: IterateRecoveriesConfig, out: Path, track: Tracker) -> None:
    """Leave success.csv and success.png, and by seed and round what was found and learnt."""
    told = cfg.choosers[cfg.compare[0]]
    setting, chooser = open_setting(cfg), get_chooser(told.name, told.params)
    shared = {name: getattr(cfg, name) for name in ("failure_rounds", "rounds", "episodes", "max_modes", "development")}
    budget = Budget(**shared, **cfg.executions.model_dump())
    budget.check(setting.graph, chooser)
    world = get_world(cfg.world.name, {**cfg.world.params, "estimator": IMPROVING})
    task = Task(world, get_symbols(world.name, world), setting.task.preconditions)
    field = Field(task, get_options(world.name, world), cfg.max_options, cfg.slots)
    origin = load_failures(cfg.failures, "train").origin
    code = "" if cfg.records else code_digest(*RECOVERING)
    rows: list[dict[str, Any]] = []
    with counter(f"iterate {cfg.item}", "round", cfg.failure_rounds * cfg.rounds * len(cfg.seeds)) as show:
        for seed in cfg.seeds:
            known = cfg.records and cfg.records / f"{cfg.item}-ledger-s{seed}.npz"
            one = Iteration(field, chooser, budget, origin, cfg.seed, seed, out / f"s{seed}", known, code, show)
            rows += one.run(setting)
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


if __name__ == "__main__":
    run()

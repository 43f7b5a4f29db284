"""Stage `iterate_recoveries`: failure rounds, each learning from what the recoveries before it left unsolved."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd

from p2l.artifacts import save_json
from p2l.contracts.world import symbols_of
from p2l.evaluation.metareskill.iterations import ALL, success_figure, success_table
from p2l.evaluation.sheets import save_sheets
from p2l.metareskill.choosers.table import make_chooser
from p2l.metareskill.failure_rounds.field import Field
from p2l.metareskill.failure_rounds.iteration import Budget, Iteration
from p2l.metareskill.places import ESTIMATOR
from p2l.metareskill.target import RecoveryTask
from p2l.schema import IterateRecoveriesConfig
from p2l.tracking import Tracker
from p2l.worlds.table import make_world
from stages._bridge import code_of, fields_of
from stages._progress import counter
from stages._recovery import inputs_of
from stages._stage import stage


@stage("iterate_recoveries", IterateRecoveriesConfig)
def run(cfg: IterateRecoveriesConfig, out: Path, track: Tracker) -> None:
    """Leave success.csv and success.png, and by seed and round what was found and learnt."""
    choice = cfg.choosers[cfg.compare[0]]
    inputs, chooser = inputs_of(cfg, out), make_chooser(choice.key, choice.params)
    counts = fields_of(cfg, Budget) | cfg.executions.model_dump()
    budget = Budget(**counts)
    budget.check(inputs.setting.graph, chooser)
    world = make_world(cfg.world.key, {**cfg.world.params, "estimator": ESTIMATOR})
    task = RecoveryTask(world, symbols_of(world), inputs.setting.task.preconditions)
    field = Field(task, world.nominal_options(), cfg.max_options, cfg.slots)
    origin, code = inputs.train.origin, code_of("iterate_recoveries", cfg, cfg.records)
    rows: list[dict[str, Any]] = []
    with counter(f"iterate {cfg.item}", "round", cfg.failure_rounds * cfg.rounds * len(cfg.seeds)) as show:
        for seed in cfg.seeds:
            ledger = cfg.records and cfg.records / f"{cfg.item}-ledger-s{seed}.npz"
            one = Iteration(field, chooser, budget, origin, cfg.seed, seed, out / f"s{seed}", ledger, code, show)
            rows += one.run(inputs.setting)
    table = success_table(pd.DataFrame(rows))
    save_sheets(out, {"success": table}, {"success": success_figure(table, f"{cfg.item}: success by failure round")})
    over_seeds = table[table["seed"] == ALL]
    success = dict(zip((f"success/{n}" for n in over_seeds["round"]), over_seeds["success"].tolist(), strict=True))
    save_json(out / "summary.json", {"success": success}, schema="iterate_summary", version=1)
    track.metrics(success)
    for name in ("success.csv", "success.png"):
        track.artifact(out / name)


if __name__ == "__main__":
    run()

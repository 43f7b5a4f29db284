"""Stage `evaluate_team`: plans run in the world they were made for (thesis, section 3.5)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd

from p2l.artifacts import load_table, save_table
from p2l.domains.table import make_domain
from p2l.errors import ArtifactError
from p2l.evaluation.team.metrics import summarise
from p2l.evaluation.transfer.planned import planned_report
from p2l.schema import EvaluateTeamConfig
from p2l.seeding import generator
from p2l.team.execute import Truth, recorded_rows, recorded_truth, true_plans
from p2l.team.study import make_block
from p2l.tracking import Tracker
from stages._bridge import ledger_of
from stages._progress import bar
from stages._stage import stage


@stage("evaluate_team", EvaluateTeamConfig)
def run(cfg: EvaluateTeamConfig, out: Path, track: Tracker) -> None:
    """Execute every plan block by block; blocks and methods with a matching record are not run again."""
    domain, study = make_domain(cfg.domain.key, cfg.domain.params), cfg.study.study()
    records, identity = ledger_of("evaluate_team", cfg, out)
    plans = load_table(cfg.plans, schema="plans", version=1)
    rows: list[dict[str, Any]] = []
    truths: dict[int, Truth] = {}
    for index in range(study.blocks):
        block = make_block(domain, study, cfg.seed, index)
        if set(plans.loc[plans["block"] == index, "digest"]) != {block.digest}:
            raise ArtifactError(f"{cfg.plans}: made for other tasks; run `python -m stages.plan` again")
        with bar(f"{domain.name} block {index + 1} of {study.blocks}") as show:
            truth = recorded_truth(domain, study, cfg.seed, block, records, identity, show)
        truths[index] = truth
        best = true_plans(study, cfg.seed, block, truth, cfg.time_limit_s)
        plans_of_block = pd.concat([plans[plans["block"] == index], best])
        for _, mine in plans_of_block.groupby("method", sort=True):
            rows += recorded_rows(domain, study, cfg.seed, mine, truth, records)
        track.metrics({"blocks_done": index + 1}, step=index)
    results = pd.DataFrame(rows)
    save_table(out / "results.parquet", results, schema="team_results", version=1)
    summary = summarise(results)
    save_table(out / "summary.parquet", summary, schema="team_summary", version=1)
    planned_report(out, plans, truths, study.draws, generator(cfg.seed, "evaluate_team", domain.name, "intervals"))
    keys = summary[["regime", "level", "method", "metric"]].astype(str).agg("/".join, axis=1)
    track.metrics(dict(zip(keys.tolist(), summary["mean"].tolist(), strict=True)))


if __name__ == "__main__":
    run()

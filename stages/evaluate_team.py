"""Stage `evaluate_team`: plans run in the world they were made for (thesis, section 3.5)."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pandas as pd

from p2l.artifacts import config_hash, load_table, save_table
from p2l.errors import ArtifactError
from p2l.evaluation.team_metrics import summarise
from p2l.ledger import Item, find, write
from p2l.schema import EvaluateTeamConfig
from p2l.team.execute import Truth, execute_plans, measure_truth, true_plans
from p2l.team.study import Block, make_block
from p2l.tracking import Tracker
from p2l.worlds.domain import Domain
from p2l.worlds.registry import get_domain
from stages._progress import bar
from stages._stage import stage


@stage("evaluate_team", EvaluateTeamConfig)
def run(cfg: EvaluateTeamConfig, out: Path, track: Tracker) -> None:
    """Execute every plan block by block; blocks and methods with a matching record are not run again."""
    domain, study = get_domain(cfg.domain.name, cfg.domain.params), cfg.study.study()
    records = cfg.records or out / "records"
    plans = load_table(cfg.plans, schema="plans", version=1)
    if set(plans["identity"]) != {cfg.identity}:
        raise ArtifactError(f"{cfg.plans}: made for another domain, study or seed; run `python -m stages.plan` again")
    rows: list[dict[str, Any]] = []
    for index in range(study.blocks):
        block = make_block(domain, study, cfg.seed, index)
        truth = _truth(cfg, domain, block, records)
        best = true_plans(study, cfg.seed, block, truth, cfg.time_limit_s)
        made = pd.concat([plans[plans["block"] == index].drop(columns="identity"), best])
        for method, chosen in made.groupby("method", sort=True):
            item = Item(domain.name, str(method), index, config_hash([cfg.identity, chosen.to_dict("records")]))
            if (known := find(records, item)) is None:
                known = {"rows": execute_plans(chosen, study.regimes, truth).to_dict("records")}
                write(records, item, known, seconds=0.0)
            rows += known["rows"]
        track.metrics({"blocks_done": index + 1}, step=index)
    results = pd.DataFrame(rows)
    save_table(out / "results.parquet", results, schema="team_results", version=1)
    summary = summarise(results)
    save_table(out / "summary.parquet", summary, schema="team_summary", version=1)
    keys = summary[["regime", "level", "method", "metric"]].astype(str).agg("/".join, axis=1)
    track.metrics(dict(zip(keys.tolist(), summary["mean"].tolist(), strict=True)))


def _truth(cfg: EvaluateTeamConfig, domain: Domain, block: Block, records: Path) -> Truth:
    """What is true of a block's skills, from its record or by simulation."""
    item = Item(domain.name, "truth", block.index, cfg.identity)
    if (known := find(records, item)) is None:
        start = time.perf_counter()
        with bar(f"{domain.name} block {block.index + 1}") as progress:
            truth = measure_truth(domain, cfg.study.study(), cfg.seed, block, progress)
        known = {"planning": truth.planning.tolist(), "executing": truth.executing.tolist()}
        write(records, item, known, seconds=time.perf_counter() - start)
    return Truth(known["planning"], known["executing"])


if __name__ == "__main__":
    run()

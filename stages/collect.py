"""Stage `collect`: Algorithm 1 in a domain's abstract simulation."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from p2l.artifacts import atomic, load_json, save_arrays, save_json
from p2l.domains.table import make_domain
from p2l.evaluation.statistics import wilson_interval
from p2l.evaluation.transfer.strategies import strategy_figure
from p2l.records import Array
from p2l.schema import CollectConfig
from p2l.tracking import Tracker
from p2l.transfer.collection import collect
from stages._archive import archive_of
from stages._progress import bar
from stages._stage import stage

VERSION = 1  # raise it when an edit of the code collects other successes: committed records know no code
FILES = ("transfer_data.npz", "strategy.png", "summary.json")


@stage("collect", CollectConfig)
def run(cfg: CollectConfig, out: Path, track: Tracker) -> None:
    """Learn skills, try every skill on every task, and say whether the skills need the walls."""
    archive = archive_of("collect", VERSION, cfg, FILES)
    if not archive.restore(out):
        begin = time.perf_counter()
        _collect(cfg, out)
        archive.keep(out, seconds=time.perf_counter() - begin)
    track.artifact(out / "strategy.png")
    summary = load_json(out / "summary.json", schema="collect_summary", version=1)
    track.metrics({key: value["mean"] for key, value in summary.items() if isinstance(value, dict)})


def _collect(cfg: CollectConfig, out: Path) -> None:
    """Run Algorithm 1 and write the files."""
    domain = make_domain(cfg.domain.key, cfg.domain.params)
    with bar(f"collect {domain.name}") as show:
        collection = collect(
            domain, n_tasks=cfg.n_tasks, n_taught=cfg.n_taught, draws=cfg.draws, seed=cfg.seed, progress=show
        )
    save_arrays(out / "transfer_data.npz", collection.data.arrays(), schema="transfer_data", version=1)
    with atomic(out / "strategy.png") as temporary:
        temporary.write_bytes(
            strategy_figure(collection.views, f"{domain.name}: learnt skills on their own tasks, seen from above")
        )
    rate = collection.data.rate
    others = np.ones_like(rate, dtype=bool)
    others[np.arange(len(rate)), collection.data.train_task] = False
    summary = {
        "n_tasks": cfg.n_tasks,
        "n_skills": cfg.n_taught,
        "draws": cfg.draws,
        "own_task_success": _rate(collection.own_rate, cfg.draws),
        "other_task_success": float(rate[others].mean()) if others.any() else None,
    }
    if collection.own_rate_without_walls is not None:
        summary["own_task_success_without_walls"] = _rate(collection.own_rate_without_walls, cfg.draws)
    save_json(out / "summary.json", summary, schema="collect_summary", version=1)


def _rate(rates: Array, draws: int) -> dict[str, float]:
    trials = rates.size * draws
    low, high = wilson_interval(float(rates.sum()) * draws, trials)
    return {"mean": float(rates.mean()), "low": float(low), "high": float(high), "trials": trials}


if __name__ == "__main__":
    run()

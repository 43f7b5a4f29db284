"""What `collect` leaves of a collection: the data, learnt skills seen from above, and how well skills do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from p2l.artifacts import atomic, save_arrays, save_json
from p2l.evaluation.statistics import wilson_interval
from p2l.evaluation.transfer.strategies import strategy_figure
from p2l.records import Array
from p2l.transfer.collection import Collection


def collection_report(out: Path, domain: str, collection: Collection) -> None:
    """Write transfer_data.npz, strategy.png and summary.json; `domain` is the name, for the title."""
    data = collection.data
    save_arrays(out / "transfer_data.npz", data.arrays(), schema="transfer_data", version=1)
    title = f"{domain}: learnt skills on their own tasks, seen from above"
    with atomic(out / "strategy.png") as temporary:
        temporary.write_bytes(strategy_figure(collection.views, title))
    others = np.ones_like(data.rate, dtype=bool)
    others[np.arange(len(data.rate)), data.train_task] = False
    summary: dict[str, Any] = {
        "n_tasks": len(data.names),
        "n_skills": len(data.train_task),
        "draws": data.draws,
        "own_task_success": _rate(collection.own_rate, data.draws),
        "other_task_success": float(data.rate[others].mean()) if others.any() else None,
    }
    if collection.own_rate_without_walls is not None:
        summary["own_task_success_without_walls"] = _rate(collection.own_rate_without_walls, data.draws)
    save_json(out / "summary.json", summary, schema="collect_summary", version=1)


def _rate(rates: Array, draws: int) -> dict[str, float]:
    trials = rates.size * draws
    low, high = wilson_interval(float(rates.sum()) * draws, trials)
    return {"mean": float(rates.mean()), "low": float(low), "high": float(high), "trials": trials}

"""Means and intervals over executed plans: the numbers behind the tables and figures of chapter 3."""

from __future__ import annotations

import pandas as pd

from p2l.evaluation.statistics import paired_difference, t_interval

METRICS = ("predicted_cost", "executed_cost", "demos", "delegated", "attempts", "failures")
BASE = "adl"


def summarise(results: pd.DataFrame) -> pd.DataFrame:
    """Mean and 95 % t interval over the sets, one row per (regime, level, method, metric).

    `excess_cost` is the paired difference of the executed cost to ADL's on the same sets.

    Args:
        results: one row per (set, regime, level, method), as `p2l.team.execute.execute_plans` returns them.
    """
    rows = []
    for (regime, level), cases in results.groupby(["regime", "level"], sort=True):
        base = cases[cases["method"] == BASE].sort_values("set")["executed_cost"].to_numpy()
        for method, group in cases.groupby("method", sort=True):
            sets = group.sort_values("set")
            intervals = {metric: t_interval(sets[metric].to_numpy()) for metric in METRICS}
            if method != BASE and len(base) == len(sets):
                intervals["excess_cost"] = paired_difference(sets["executed_cost"].to_numpy(), base)
            for metric, interval in intervals.items():
                limits = [float(value) if interval.n > 1 else None for value in (interval.low, interval.high)]
                rows.append((regime, level, method, metric, float(interval.mean), *limits, interval.n))
    columns = ["regime", "level", "method", "metric", "mean", "low", "high", "n"]
    return pd.DataFrame(rows, columns=columns).astype({"low": float, "high": float})

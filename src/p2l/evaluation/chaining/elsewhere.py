"""Table 5.2: policies, unchanged, in worlds other than that of their training."""

from __future__ import annotations

import pandas as pd

from p2l.evaluation.rows import Row, interval_row, rate_row, table_of
from p2l.evaluation.statistics import t_interval
from p2l.evaluation.thesis import Thesis

TABLE = "table_5_2"


def table_5_2(world: str, transfers: pd.DataFrame, thesis: Thesis) -> pd.DataFrame:
    """Recovery rate of every variant: pooled over seeds (Wilson limits), the seeds' mean (t limits), and the seeds.

    Args:
        world: name of the item.
        transfers: rows of `p2l.chaining.elsewhere.transfer_of_seed`, of all seeds.
        thesis: for the column of its numbers.
    """
    rows: list[Row] = []
    for (variant, learner), part in transfers.groupby(["variant", "learner"], sort=False):
        method, setting = str(learner), f"world={world};variant={variant}"
        rows.append(rate_row(method, setting, "recovery", int(part["recovered"].sum()), int(part["failures"].sum())))
        some = part[part["failures"] > 0]
        if not len(some):
            continue
        rates = (some["recovered"] / some["failures"]).to_numpy(dtype=float)
        rows.append(interval_row(method, setting, "recovery_by_seed", t_interval(rates)))
        for one in some.to_dict("records"):
            counts = int(one["recovered"]), int(one["failures"])
            rows.append(rate_row(method, f"{setting};seed={one['seed']}", "recovery", *counts))
    return thesis.beside(table_of(rows), TABLE)

"""Table 5.2: policies, unchanged, in worlds other than that of their training."""

from __future__ import annotations

import pandas as pd

from p2l.evaluation.rows import Row, interval_row, rate_row, table_of
from p2l.evaluation.statistics import rate_interval
from p2l.evaluation.thesis import Thesis

TABLE = "table_5_2"


def table_5_2(world: str, transfers: pd.DataFrame, thesis: Thesis) -> pd.DataFrame:
    """Recovery rate of every variant, over the trainings (`statistics.rate_interval`) and of each.

    Args:
        world: name of the item.
        transfers: rows of `p2l.chaining.elsewhere.transfer_of_seed`, of all seeds.
        thesis: for the column of its numbers.
    """
    rows: list[Row] = []
    for (variant, learner), part in transfers.groupby(["variant", "learner"], sort=False):
        method, setting = str(learner), f"world={world};variant={variant}"
        rows.append(interval_row(method, setting, "recovery", rate_interval(part["recovered"], part["failures"])))
        for one in part[part["failures"] > 0].to_dict("records"):
            counts = int(one["recovered"]), int(one["failures"])
            rows.append(rate_row(method, f"{setting};seed={one['seed']}", "recovery", *counts))
    return thesis.beside(table_of(rows), TABLE)

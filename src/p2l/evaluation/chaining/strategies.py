"""Success of each recovery strategy (thesis, sections 5.4.1 and 5.4.2)."""

from __future__ import annotations

import pandas as pd

from p2l.evaluation.rows import Row, table_of, trained_row
from p2l.evaluation.thesis import Thesis

TABLE = "strategies_5"


def strategies_5(world: str, reuse: pd.DataFrame, thesis: Thesis) -> pd.DataFrame:
    """Of every strategy, `share`: of the recovered failures; `recovery`: of the failures it was tried on.

    Intervals are `statistics.rate_interval`'s.

    Args:
        world: name of the item.
        reuse: rows of `p2l.chaining.reuse`, of all seeds.
        thesis: for the column of its numbers.
    """
    rows: list[Row] = []
    for learner, part in reuse.groupby("learner", sort=False):
        success = part["success"].astype(bool)
        for name in sorted(set(part["strategy"])):
            mine, setting = part["strategy"] == name, f"world={world};strategy={name}"
            for metric, among, hits in (("share", success, mine), ("recovery", mine, success)):
                rows.append(trained_row(str(learner), setting, metric, hits[among], part["seed"][among]))
    return thesis.beside(table_of(rows), TABLE)

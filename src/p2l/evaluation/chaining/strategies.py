"""Success of each recovery strategy (thesis, sections 5.4.1 and 5.4.2)."""

from __future__ import annotations

import pandas as pd

from p2l.evaluation.rows import Row, rate_row, table_of
from p2l.evaluation.thesis import Thesis

TABLE = "strategies_5"


def strategies_5(world: str, reuse: pd.DataFrame, thesis: Thesis) -> pd.DataFrame:
    """Of every strategy, `share`: of the recovered failures; `recovery`: of the failures it was tried on (Wilson).

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
            successes = int((mine & success).sum())
            rows.append(rate_row(str(learner), setting, "share", successes, int(success.sum())))
            rows.append(rate_row(str(learner), setting, "recovery", successes, int(mine.sum())))
    return thesis.beside(table_of(rows), TABLE)

"""The table of planning for an uncertain tomorrow: costs of every method, and what planning for samples saves."""

from __future__ import annotations

import numpy as np
import pandas as pd

from p2l.evaluation.rows import COLUMNS, Row, interval_row, table_of
from p2l.evaluation.statistics import paired_difference, t_interval

_METRICS = ("executed_cost", "planned_cost", "lessons_today")


def tomorrow_table(results: pd.DataFrame, domain: str) -> pd.DataFrame:
    """Means over task sets with 95 % t limits, and differences to `sample`, paired by set (positive: it saves).

    Args:
        results: rows of `p2l.team.tomorrow.study.compare`.
        domain: of these rows.
    """
    rows: list[Row] = []
    for (regime, kind), group in results.groupby(["regime", "kind"], sort=True):
        setting = f"domain={domain};regime={regime};futures={kind}"
        values = {str(name): each.sort_values("set") for name, each in group.groupby("method", sort=True)}
        ours = values["sample"]
        for name, each in values.items():
            for metric in _METRICS:
                sample = each[metric].dropna().to_numpy(dtype=float)
                if len(sample):
                    rows.append(interval_row(name, setting, metric, t_interval(sample)))
            if name == "sample":
                continue
            for metric in _METRICS[:2]:
                saved = paired_difference(each[metric].to_numpy(dtype=float), ours[metric].to_numpy(dtype=float))
                rows.append(interval_row(name, setting, f"{metric}_over_sample", saved))
    return table_of(rows).assign(thesis=np.nan)[list(COLUMNS)]

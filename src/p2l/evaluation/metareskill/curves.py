"""The data of figures 4.6 and 4.7 as long tables, and the figures, drawn from those tables alone.

Columns are those of `evaluation.rows`; rows with `seed=…` in their setting are single seeds, the others the mean over
seeds with 95 % t limits. `value` is the value of failures (equation 4.2), in units of the skill graph's rewards.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from p2l.evaluation.metareskill.figures import allocation_figure, value_figure
from p2l.evaluation.metareskill.rounds import comparison_table
from p2l.evaluation.rows import Row, interval_row, rate_row, single_row, table_of
from p2l.evaluation.statistics import t_interval
from p2l.evaluation.thesis import Thesis

FIGURE_4_6, FIGURE_4_7 = "figure_4_6", "figure_4_7"
STEADY = "round_robin"


def figure_4_7(values: pd.DataFrame, chooser: str, thesis: Thesis) -> pd.DataFrame:
    """Value of failures against queries, and `chooser` against every other, paired by seed.

    Metrics: `value` (setting `queries=…`); of `chooser` with setting `over=…`: `final_gain`, difference of final
    values; `better`, share of seeds in which it is above 0; `budget_share`, part of the budget after which it is as
    good as the other ever becomes (seeds in which it never is are left out, and `reached` says how many are).

    Args:
        values: `seed, chooser, queries, value`.
        chooser: whose values are compared with every other's.
        thesis: chapter 4.
    """
    rows = _values(values)
    comparison = comparison_table(values, chooser)
    for other, part in comparison.groupby("other", sort=False):
        setting = f"over={other}"
        gains = (part["final"] - part["final_other"]).to_numpy(dtype=float)
        shares = part["share"].to_numpy(dtype=float)
        for seed, gain, share in zip(part["seed"], gains, shares, strict=True):
            rows.append(single_row(chooser, f"seed={seed};{setting}", "final_gain", gain))
            rows.append(single_row(chooser, f"seed={seed};{setting}", "budget_share", share))
        rows.append(interval_row(chooser, setting, "final_gain", t_interval(gains)))
        parity = np.isfinite(shares)
        if parity.any():
            rows.append(interval_row(chooser, setting, "budget_share", t_interval(shares[parity])))
        early = parity & (np.nan_to_num(shares, nan=1.0) <= 0.7)
        for name, hits in (("better", gains > 0.0), ("reached", parity), ("within_70_percent", early)):
            rows.append(rate_row(chooser, setting, name, int(hits.sum()), len(hits)))
    return thesis.beside(table_of(rows), FIGURE_4_7)


def figure_4_6(values: pd.DataFrame, allocation: pd.DataFrame, choosers: Sequence[str], thesis: Thesis) -> pd.DataFrame:
    """Left, how round-robin's value saturates; right, the rounds that every recovery got, and its success rate q.

    Args:
        values: `seed, chooser, queries, value`.
        allocation: `seed, chooser, mode, target, trained, q`.
        choosers: whose allocation is shown; without round-robin the first one's values are.
        thesis: chapter 4.
    """
    steady = STEADY if STEADY in set(values["chooser"]) else choosers[0]
    rows = _values(values[values["chooser"] == steady])
    selection = allocation[allocation["chooser"].isin(choosers)]
    for (chooser, mode, target), part in selection.groupby(["chooser", "mode", "target"], sort=False):
        setting = f"mode={mode};target={target}"
        for metric in ("trained", "q"):
            numbers = part[metric].to_numpy(dtype=float)
            for seed, number in zip(part["seed"], numbers, strict=True):
                rows.append(single_row(str(chooser), f"seed={seed};{setting}", metric, number))
            rows.append(interval_row(str(chooser), setting, metric, t_interval(numbers)))
    return thesis.beside(table_of(rows), FIGURE_4_6)


def draw_4_7(table: pd.DataFrame, title: str) -> Figure:
    """Figure 4.7 from its table: mean and band over seeds of every chooser."""
    return value_figure(_curves(table), title)


def draw_4_6(table: pd.DataFrame, title: str) -> Figure:
    """Figure 4.6 from its table: round-robin's value over queries, and the rounds of each recovery by chooser."""
    parts = table["setting"].str.extract(r"^seed=(?P<seed>\d+);mode=(?P<mode>\d+);target=(?P<target>[^;]+)$")
    mask = parts["seed"].notna() & (table["metric"] == "trained")
    allocation = parts[mask].assign(chooser=table["method"][mask], trained=table["mean"][mask])
    choosers = list(dict.fromkeys(allocation["chooser"]))
    return allocation_figure(_curves(table), allocation, choosers, title)


def _values(values: pd.DataFrame) -> list[Row]:
    rows: list[Row] = []
    for chooser, part in values.groupby("chooser", sort=False):
        for seed, own in part.groupby("seed", sort=True):
            pairs = zip(own["queries"], own["value"], strict=True)
            rows += [single_row(str(chooser), f"seed={seed};queries={count}", "value", value) for count, value in pairs]
        for count, own in part.groupby("queries", sort=True):
            rows.append(
                interval_row(str(chooser), f"queries={count}", "value", t_interval(own["value"].to_numpy(dtype=float)))
            )
    return rows


def _curves(table: pd.DataFrame) -> pd.DataFrame:
    parts = table["setting"].str.extract(r"^seed=(?P<seed>\d+);queries=(?P<queries>\d+)$")
    mask = parts["seed"].notna() & (table["metric"] == "value")
    return parts[mask].astype(int).assign(chooser=table["method"][mask], value=table["mean"][mask])

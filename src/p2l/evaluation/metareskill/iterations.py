"""Success after each failure round, as a table and a figure."""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, PercentFormatter

from p2l.evaluation.statistics import rate_interval, wilson_interval
from p2l.evaluation.style import plain

ALL = "all"
_SUMS = ["episodes", "successes", "found"]


def success_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Columns `round, seed, queries, modes, found, episodes, successes, success, low, high`.

    Args:
        rows: those of each round and seed up to `successes`. Round 0 has no recoveries; `found` are the new failures
            that a round learns from. Rounds of all seeds get an aggregate row too, whose `seed` is "all"; its interval
            is `statistics.rate_interval`'s.
    """
    seeds = rows["seed"].nunique()
    groups = [(number, group) for number, group in rows.groupby("round") if len(group) == seeds]
    aggregates = [
        {"round": number, "seed": ALL, "queries": group["queries"].max()} | group[_SUMS].sum().to_dict()
        for number, group in groups
    ]
    table = pd.concat([rows.astype({"seed": str, "modes": "Int64"}), pd.DataFrame(aggregates)], ignore_index=True)
    low, high = wilson_interval(table["successes"], table["episodes"])
    table = table.assign(success=table["successes"] / table["episodes"], low=low, high=high)
    for number, group in groups:
        over = rate_interval(group["successes"], group["episodes"])
        here = (table["seed"] == ALL) & (table["round"] == number)
        table.loc[here, ["success", "low", "high"]] = float(over.mean), float(over.low), float(over.high)
    return table


def success_figure(table: pd.DataFrame, title: str) -> Figure:
    """Success over all seeds with its 95 % interval, and each seed as a faint line."""
    figure = Figure(figsize=(6.0, 4.0), layout="constrained")
    axes = figure.add_subplot()
    for _, mine in table[table["seed"] != ALL].groupby("seed"):
        axes.plot(mine["round"], mine["success"], color="0.75", lw=1.0)
    aggregates = table[table["seed"] == ALL]
    bars = [aggregates["success"] - aggregates["low"], aggregates["high"] - aggregates["success"]]
    axes.errorbar(aggregates["round"], aggregates["success"], bars, color="#0072B2", marker="o", capsize=4.0, lw=2.0)
    axes.set(xlabel="failure round (0: no recoveries)", ylabel="success on development starts", title=title)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    plain(axes)
    return figure

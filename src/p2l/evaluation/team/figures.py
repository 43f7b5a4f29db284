"""Figures 3.7, 3.9 and 3.10: what the methods cost, against pre-training and in parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from p2l.evaluation.statistics import t_interval
from p2l.evaluation.style import COST, METHODS, THESIS_METHODS, label_ends, plain
from p2l.records import Array

DASHES = (0, (4, 3))
# Parts of a cost: (count in the results, costs it is paid at, name, colour).
PARTS = (
    ("attempts", "c_rob", "robot attempts", "#4477AA"),
    ("failures", "c_fail", "failures", "#EE8866"),
    ("delegated", "c_hum", "delegated to the person", "#BBBBBB"),
    ("demos", "c_demo", "demonstrations", "#CC6677"),
)


def cost_by_pretraining(
    summary: pd.DataFrame, panels: Mapping[str, str], note: str, methods: Sequence[str] = THESIS_METHODS
) -> Figure:
    """Cost against the number of pre-trained skills, one column of panels per cost regime.

    Above the mean cost, executed (solid) and predicted (dashed); below the executed cost minus ADL's on the same sets,
    with 95 % bands, since sets differ far more from each other than methods do on one set.

    Args:
        summary: `team_summary` rows.
        panels: regime → title of its column.
        note: what means and intervals are over.
        methods: in drawing order from front to back; the first is ADL.
    """
    figure = Figure(figsize=(1.4 + 5.6 * len(panels), 7.6), layout="constrained")
    grid = figure.subplots(2, len(panels), squeeze=False, sharex="col", sharey="row", height_ratios=(3, 2))
    for (above, below), (regime, title) in zip(grid.T, panels.items(), strict=True):
        rows = summary[summary["regime"] == regime]
        present = [method for method in methods if (rows["method"] == method).any()]
        above.set_ylim(
            0.0, 1.06 * max(rows.loc[rows["metric"].isin(["executed_cost", "predicted_cost"]), "mean"], default=1.0)
        )
        above.set_title(title, fontsize=11)
        below.set(xlabel="number of pre-trained skills", xticks=sorted(set(rows["level"])))
        for depth, method in enumerate(present):
            cost_line(above, rows, method, 10.0 - depth)
            _excess_line(below, rows, method, 10.0 - depth)
    for above, below in grid.T:  # after all panels have settled the shared limits
        for axes in (above, below):
            plain(axes)
            label_lines(axes, gap=0.055 if axes is above else 0.08)
    grid[0, 0].set_ylabel(f"mean {COST}")
    grid[1, 0].set_ylabel("executed cost more than ADL,\nunits of effort")
    lines = [Line2D([], [], color="0.3", lw=2), Line2D([], [], color="0.3", lw=1, ls=DASHES), Patch(color="0.8")]
    names = ["executed", "predicted by the planner", "95 % t interval of the difference on the same sets"]
    figure.legend(
        lines,
        names,
        loc="outside lower center",
        ncols=3 if len(panels) > 1 else 2,
        frameon=False,
        fontsize=9,
        title=note,
        title_fontsize=9,
    )
    return figure


def cost_line(axes: Axes, rows: pd.DataFrame, method: str, front: float, *, prediction: bool = True) -> None:
    """Mean cost of a method against pre-training: executed solid, predicted dashed; rows of one regime."""
    style = METHODS[method]
    level, mean = _series(rows, method, "executed_cost", "mean")
    axes.plot(
        level,
        mean,
        color=style.colour,
        marker=style.marker,
        ms=5,
        lw=style.width,
        zorder=front,
        label=style.label,
        gid="labelled",
    )
    if prediction:
        axes.plot(*_series(rows, method, "predicted_cost", "mean"), color=style.colour, lw=1, ls=DASHES, zorder=front)


def _excess_line(axes: Axes, rows: pd.DataFrame, method: str, front: float) -> None:
    style = METHODS[method]
    line: dict[str, Any] = {"color": style.colour, "marker": style.marker, "ms": 5, "lw": style.width, "zorder": front}
    line |= {"label": style.label, "gid": "labelled"}
    if method == "adl":
        levels = sorted(set(rows["level"]))
        axes.plot(levels, np.zeros(len(levels)), **line)
        return
    level, mean = _series(rows, method, "excess_cost", "mean")
    low, high = (_series(rows, method, "excess_cost", name)[1] for name in ("low", "high"))
    axes.fill_between(level, low, high, color=style.colour, alpha=0.15, lw=0)
    axes.plot(level, mean, **line)


def _series(rows: pd.DataFrame, method: str, metric: str, column: str) -> tuple[Array, Array]:
    mine = rows[(rows["method"] == method) & (rows["metric"] == metric)].sort_values("level")
    return mine["level"].to_numpy(dtype=float), mine[column].to_numpy(dtype=float)


def label_lines(axes: Axes, gap: float = 0.055) -> None:
    """Name the lines of methods at their ends; the axes' limits must be final."""
    label_ends(axes, [_end(line) for line in axes.lines if line.get_gid() == "labelled"], gap)


def _end(line: Line2D) -> tuple[float, float, str, str]:
    x, y = (np.asarray(data, dtype=float)[-1] for data in line.get_data())
    return float(x), float(y), str(line.get_label()), str(line.get_color())


def cost_by_method(
    results: pd.DataFrame,
    costs: Mapping[str, float],
    thesis: Mapping[str, float],
    title: str,
    methods: Sequence[str] = THESIS_METHODS,
) -> Figure:
    """Figure 3.9: mean executed cost of each method in its parts, with counts and the 95 % interval of the total.

    Args:
        results: `team_results` rows of one regime and level.
        costs: c_rob, c_hum, c_fail, c_demo.
        thesis: method → the thesis's total, drawn as a mark.
        title: of the figure.
        methods: from left to right.
    """
    figure = Figure(figsize=(1.6 * len(methods) + 1.4, 5.2), layout="constrained")
    axes = figure.add_subplot()
    groups = {method: results[results["method"] == method] for method in methods}
    means = pd.DataFrame({method: group[[part[0] for part in PARTS]].mean() for method, group in groups.items()})
    bottom = np.zeros(len(methods))
    for count, price, name, colour in PARTS:
        height = means.loc[count].to_numpy(dtype=float) * costs[price]
        axes.bar(range(len(methods)), height, 0.62, bottom, color=colour, label=f"{name} ({costs[price]:g} each)")
        _name_parts(axes, means.loc[count].to_numpy(dtype=float), bottom, height)
        bottom += height
    for place, group in enumerate(groups.values()):
        total = t_interval(group["executed_cost"].to_numpy())
        if total.n > 1:
            spread = [[float(total.mean - total.low)], [float(total.high - total.mean)]]
            axes.errorbar(place, float(total.mean), yerr=spread, color="black", capsize=4, lw=1.2)
        top = float(np.nanmax([total.mean, total.high]))
        axes.annotate(
            f"{total.mean:.0f}", (place, top), xytext=(0, 4), textcoords="offset points", ha="center", fontweight="bold"
        )
    marks = [(place, thesis[method]) for place, method in enumerate(methods) if method in thesis]
    if marks:
        x, y = zip(*marks, strict=True)
        axes.scatter(np.array(x) + 0.4, y, marker="<", color="black", s=45, label="thesis, total", zorder=5)
    axes.set_xticks(range(len(methods)), [METHODS[method].label for method in methods])
    plain(axes)
    axes.set(ylabel=f"executed {COST}", title=title)
    axes.margins(y=0.12)
    handles, names = axes.get_legend_handles_labels()
    bars_first = sorted(range(len(names)), key=lambda index: names[index].startswith("thesis"))
    figure.legend(
        [handles[index] for index in bars_first],
        [names[index] for index in bars_first],
        loc="outside lower center",
        ncols=3,
        frameon=False,
        fontsize=9,
    )
    return figure


def _name_parts(axes: Axes, counts: Array, bottom: Array, height: Array) -> None:
    """Write a part's count into its bar where the bar is high enough to hold it."""
    for place in np.flatnonzero(height >= 40.0):
        middle = bottom[place] + height[place] / 2
        axes.annotate(f"{counts[place]:.1f}", (place - 0.27, middle), ha="left", va="center", fontsize=8)

"""Figures 4.6 and 4.7, and the skill graph after training, drawn from the tables of `rounds`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from p2l.evaluation.style import label_ends, plain
from p2l.metareskill.graph import SkillGraph
from p2l.records import IntArray

CHOOSERS = {
    "metareskill": ("MetaReSkill", "#0072B2", 2.6),
    "round_robin": ("round-robin", "#E69F00", 1.5),
    "weighted_round_robin": ("weighted round-robin", "#CC79A7", 1.5),
    "ucb1": ("UCB1", "#009E73", 1.5),
    "thompson": ("Thompson", "#D55E00", 1.5),
}
OTHER = ("#56B4E9", 1.5)
GRAPH = "success rates on held-out states and failures; thick edges were trained often, grey ones never succeeded"
Place = tuple[float, float]


def look(chooser: str) -> tuple[str, str, float]:
    """Label, colour and line width of a chooser."""
    return CHOOSERS.get(chooser, (name_label(chooser), *OTHER))


def value_figure(values: pd.DataFrame, title: str) -> Figure:
    """Figure 4.7: value of failures against queries, the mean over seeds and the band of all of them."""
    figure = Figure(figsize=(7.2, 4.4), layout="constrained")
    axes = figure.add_subplot()
    _curves(axes, values, list(dict.fromkeys(values["chooser"])))
    axes.set(xlabel="REPS queries", ylabel="value of failures, in rewards", title=title)
    return figure


def allocation_figure(values: pd.DataFrame, allocation: pd.DataFrame, choosers: Sequence[str], title: str) -> Figure:
    """Figure 4.6: round-robin's value saturates; what each recovery got from each of `choosers`, mean over seeds."""
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 2))
    steady = "round_robin" if "round_robin" in set(values["chooser"]) else choosers[0]
    _curves(left, values, [steady])
    left.set(xlabel="REPS queries", ylabel="value of failures, in rewards")
    pairs = allocation[["mode", "target"]].drop_duplicates().itertuples(index=False)
    names = [f"{mode} → {name_label(str(target))}" for mode, target in pairs]
    width = 0.8 / len(choosers)
    for number, chooser in enumerate(choosers):
        mine = allocation[allocation["chooser"] == chooser]
        counts = mine.groupby(["mode", "target"], sort=False)["trained"].mean()
        label, colour, _ = look(chooser)
        right.bar(np.arange(len(names)) + number * width - 0.4 + width / 2, counts, width, color=colour, label=label)
    right.set_xticks(range(len(names)), names, rotation=60, ha="right", fontsize=7)
    right.set(ylabel="rounds of training (mean of seeds)", xlabel="recovery (failure mode → where it leads)")
    right.legend(frameon=False)
    right.yaxis.set_major_locator(MaxNLocator(integer=True))
    for axes in (left, right):
        plain(axes)
    figure.suptitle(title)
    return figure


def graph_figure(graph: SkillGraph, trainings: IntArray, targets: Sequence[str], title: str) -> Figure:
    """The skill graph: success rates on the edges; a recovery's edge is as thick as it was trained often.

    Args:
        graph: after training.
        trainings: [I, M] rounds of training of each recovery.
        targets: M names of preconditions, the goal last.
        title: of the figure.
    """
    modes = len(graph.sizes)
    figure = Figure(figsize=(max(8.0, 1.7 * modes), 5.6), layout="constrained")
    axes = figure.add_subplot()
    above = [(float(x), 1.0) for x in np.linspace(0.0, 1.0, len(targets))]
    below = [((mode + 0.5) / modes, 0.0) for mode in range(modes)]
    heights = np.linspace(0.28, 0.72, len(targets))  # one for each target, so that labels of a mode keep apart
    most = max(int(trainings.max()), 1)
    for (mode, target), count in sorted(np.ndenumerate(trainings), key=lambda pair: graph.q[pair[0]]):
        q, width = float(graph.q[mode, target]), 0.5 + 4.0 * int(count) / most
        if count:
            colour = "#0072B2" if q > 0.0 else "0.85"
            label = f"{q:.2f}" if q > 0.0 else ""
            _edge(axes, below[mode], above[target], label, float(heights[target]), colour, width)
    for number, q in enumerate(graph.nominal.tolist()):
        _edge(axes, above[number], above[number + 1], f"{q:.2f}", 0.5, "0.3", 2.0)
    for place, name in zip(above, targets, strict=True):
        _node(axes, place, name_label(name), "#D8E6F2")
    for place, (mode, share) in zip(below, enumerate(graph.share), strict=True):
        _node(axes, place, f"mode {mode}\n{share:.0%}", "#F5D08A")
    axes.set(xlim=(-0.1, 1.1), ylim=(-0.12, 1.12), title=f"{title}\n{GRAPH}")
    axes.title.set_fontsize(10)
    axes.set_axis_off()
    return figure


def name_label(name: str) -> str:
    """A name as figures write it, without underscores."""
    return name.replace("_", " ")


def _edge(axes: Axes, start: Place, end: Place, label: str, along: float, colour: str, width: float) -> None:
    arrow = {"arrowstyle": "-|>", "color": colour, "lw": width, "shrinkA": 18, "shrinkB": 18, "mutation_scale": 14}
    axes.annotate("", xy=end, xytext=start, arrowprops=arrow)
    if label:
        x, y = ((1.0 - along) * a + along * b for a, b in zip(start, end, strict=True))
        box = {"boxstyle": "square,pad=0.15", "fc": "white", "ec": "none"}
        axes.text(x, y, label, color=colour, fontsize=8, ha="center", va="center", bbox=box)


def _node(axes: Axes, place: Place, label: str, colour: str) -> None:
    box = {"boxstyle": "round,pad=0.6", "fc": colour, "ec": "0.4"}
    axes.text(*place, label, fontsize=9, ha="center", va="center", bbox=box, zorder=5)


def _curves(axes: Axes, values: pd.DataFrame, choosers: Sequence[str]) -> None:
    ends = []
    for chooser in choosers:
        table = values[values["chooser"] == chooser].pivot(index="queries", columns="seed", values="value")
        label, colour, width = look(chooser)
        mean = table.mean(axis=1)
        axes.plot(table.index, mean, color=colour, lw=width, drawstyle="steps-post")
        axes.fill_between(
            table.index, table.min(axis=1), table.max(axis=1), color=colour, alpha=0.15, lw=0, step="post"
        )
        ends.append((float(table.index[-1]), float(mean.iloc[-1]), label, colour))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    plain(axes)
    label_ends(axes, ends)

"""Figures 4.6 and 4.7, and the skill graph after training, drawn from the tables of `recovery_rounds`."""

from __future__ import annotations

from collections.abc import Sequence

import networkx as nx
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from p2l.evaluation.style import label_ends, plain
from p2l.records import IntArray
from p2l.recoveries.metareskill.graph import SkillGraph

CHOOSERS = {
    "metareskill": ("MetaReSkill", "#0072B2", 2.6),
    "round_robin": ("round-robin", "#E69F00", 1.5),
    "weighted_round_robin": ("weighted round-robin", "#CC79A7", 1.5),
    "ucb1": ("UCB1", "#009E73", 1.5),
    "thompson": ("Thompson", "#D55E00", 1.5),
}
OTHER = ("#56B4E9", 1.5)


def look(chooser: str) -> tuple[str, str, float]:
    """Label, colour and line width of a chooser."""
    return CHOOSERS.get(chooser, (chooser.replace("_", " "), *OTHER))


def value_figure(values: pd.DataFrame, title: str) -> Figure:
    """Figure 4.7: value of failures against queries, the mean over seeds and the band of all of them."""
    figure = Figure(figsize=(7.2, 4.4), layout="constrained")
    axes = figure.add_subplot()
    _curves(axes, values, list(dict.fromkeys(values["chooser"])))
    axes.set(xlabel="REPS queries", ylabel="value of failures", title=title)
    return figure


def allocation_figure(values: pd.DataFrame, allocation: pd.DataFrame, choosers: Sequence[str], title: str) -> Figure:
    """Figure 4.6: round-robin's value saturates; what each recovery got from each of `choosers`, mean over seeds."""
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 2))
    steady = "round_robin" if "round_robin" in set(values["chooser"]) else choosers[0]
    _curves(left, values, [steady])
    left.set(xlabel="REPS queries", ylabel="value of failures")
    pairs = allocation[["mode", "target"]].drop_duplicates().itertuples(index=False)
    names = [f"({mode}, {target})" for mode, target in pairs]
    width = 0.8 / len(choosers)
    for number, chooser in enumerate(choosers):
        mine = allocation[allocation["chooser"] == chooser]
        counts = mine.groupby(["mode", "target"], sort=False)["trained"].mean()
        label, colour, _ = look(chooser)
        right.bar(np.arange(len(names)) + number * width - 0.4 + width / 2, counts, width, color=colour, label=label)
    right.set_xticks(range(len(names)), names, rotation=60, ha="right", fontsize=7)
    right.set(ylabel="rounds of training", xlabel="recovery (failure mode, where it leads)")
    right.legend(frameon=False)
    for axes in (left, right):
        plain(axes)
    figure.suptitle(title)
    return figure


def graph_figure(graph: SkillGraph, trained: IntArray, targets: Sequence[str], title: str) -> Figure:
    """The skill graph: probabilities on the edges; a recovery's edge is as thick as it was trained often.

    Args:
        graph: after training.
        trained: [I, M] trainings of each recovery.
        targets: M names of preconditions, the goal last.
        title: of the figure.
    """
    drawn = nx.DiGraph()
    places = {name: (2.0 * number, 1.0) for number, name in enumerate(targets)}
    gap = 2.0 * (len(targets) - 1) / max(len(graph.sizes), 1)
    modes = [f"mode {mode}\n{share:.0%}" for mode, share in enumerate(graph.share)]
    places |= {name: ((number + 0.5) * gap, 0.0) for number, name in enumerate(modes)}
    drawn.add_nodes_from(places)
    for number, q in enumerate(graph.nominal):
        drawn.add_edge(targets[number], targets[number + 1], label=f"{q:.2f}", width=2.0, colour="0.3")
    most = max(int(trained.max()), 1)
    for (mode, target), count in np.ndenumerate(trained):
        q = float(graph.q[mode, target])
        if count:
            told = {"label": f"{q:.2f}", "width": 0.5 + 4.0 * count / most, "colour": "#0072B2" if q > 0.0 else "0.8"}
            drawn.add_edge(modes[mode], targets[target], **told)
    figure = Figure(figsize=(10.0, 5.0), layout="constrained")
    axes = figure.add_subplot()
    edges = list(drawn.edges(data=True))
    style = {"width": [e["width"] for *_, e in edges], "edge_color": [e["colour"] for *_, e in edges]}
    colours = ["#E69F00" if name in modes else "#D8E6F2" for name in drawn]
    nx.draw_networkx(
        drawn,
        places,
        ax=axes,
        node_size=2600,
        node_color=colours,
        font_size=8,
        edgelist=[e[:2] for e in edges],
        **style,
    )
    labels = {(a, b): e["label"] for a, b, e in edges}
    nx.draw_networkx_edge_labels(drawn, places, labels, ax=axes, font_size=7, label_pos=0.4)
    axes.set_title(title)
    axes.set_axis_off()
    return figure


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
    plain(axes)
    label_ends(axes, ends)

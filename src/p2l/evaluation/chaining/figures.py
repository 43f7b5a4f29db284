"""Figures of chapter 5, drawn from the tables of `chain_tables`."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from p2l.evaluation.sheets import aggregates
from p2l.evaluation.style import MethodStyle, label_ends, plain
from p2l.records import Array

LEARNERS: dict[str, MethodStyle] = {
    "rc": MethodStyle("RC", "#0072B2", "o", 2.6),
    "lazy_rc": MethodStyle("Lazy RC", "#56B4E9", "P"),
    "pp": MethodStyle("PP", "#D55E00", "^"),
    "rl": MethodStyle("RL", "#555555", "X"),
    "search": MethodStyle("Search", "#009E73", "D"),
    "search_mixed": MethodStyle("Search, mixed", "#CC79A7", "D"),
}
MAIN = "rc"
BESIDE_MAIN = "success_minus_rc"
OWN_COLOURS = ("#009E73", "#CC79A7", "#E69F00", "#000000")  # of learners that are not the thesis's, by name
OPTION_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00")


def style_of(learner: str) -> MethodStyle:
    """Colour, marker and label of a learner, also of one that a user has registered."""
    if learner in LEARNERS:
        return LEARNERS[learner]
    return MethodStyle(learner.replace("_", " "), OWN_COLOURS[sum(map(ord, learner)) % len(OWN_COLOURS)], "D")


def learning_curves(table: pd.DataFrame) -> Figure:
    """Success of evaluations against control steps, one panel per world, bands (95 % t) where there are several seeds.

    Args:
        table: of `chain_tables.figure_5_5`.
    """
    rows = _with_numbers(table, "control_steps")
    worlds = list(dict.fromkeys(rows["world"]))
    figure = Figure(figsize=(4.6 * len(worlds), 3.4), layout="constrained")
    for axes, world in zip(np.ravel(figure.subplots(1, len(worlds), sharey=True)), worlds, strict=True):
        ends = []
        for learner, part in rows[rows["world"] == world].groupby("method", sort=False):
            style = style_of(str(learner))
            x, mean = part["control_steps"].to_numpy() / 1000.0, part["mean"].to_numpy()
            axes.plot(x, mean, color=style.colour, lw=style.width, drawstyle="steps-post")
            _band(axes, x, part, style.colour, step="post")
            ends.append((float(x[-1]), float(mean[-1]), style.label, style.colour))
        axes.set(ylim=(-0.02, 1.02), xlim=(0, None), xlabel="simulated control steps, thousands")
        axes.set_title(world.replace("_", " "))
        plain(axes)
        label_ends(axes, ends)
    figure.axes[0].set_ylabel("success of evaluations in training")
    return figure


def option_counts(table: pd.DataFrame, world: str, learner: str = "rc") -> Figure:
    """Counts of each nominal option per round, as in figure 5.8.

    Args:
        table: of `chain_tables.figure_5_8`.
        world: whose options.
        learner: which learner's.
    """
    rows = _with_numbers(table[table["method"] == learner], "round")
    rows = rows[rows["world"] == world]
    figure = Figure(figsize=(5.6, 3.4), layout="constrained")
    axes = figure.subplots()
    ends = []
    for number, (option, part) in enumerate(rows.groupby("metric", sort=False)):
        colour = OPTION_COLOURS[number % len(OPTION_COLOURS)]
        x, mean = part["round"].to_numpy(), part["mean"].to_numpy()
        axes.plot(x, mean, color=colour, lw=1.5)
        _band(axes, x, part, colour)
        ends.append((float(x[-1]), float(mean[-1]), str(option).replace("_", " "), colour))
    axes.set(xlabel="round of PPO", ylabel="times tried in a round", ylim=(0, None), xlim=(0, None))
    axes.set_title(f"{world.replace('_', ' ')}: nominal options tried by {style_of(learner).label}")
    plain(axes)
    if ends:  # learners without nominal options try none
        label_ends(axes, ends)
    return figure


def _band(axes: Axes, x: Array, part: pd.DataFrame, colour: str, step: Literal["post"] | None = None) -> None:
    if part["low"].notna().all():
        low, high = part["low"].to_numpy(), part["high"].to_numpy()
        axes.fill_between(x, low, high, color=colour, alpha=0.15, lw=0, step=step)


def _with_numbers(table: pd.DataFrame, number: str) -> pd.DataFrame:
    """The rows over all seeds, with their settings as columns."""
    table = aggregates(table)
    parts = table["setting"].str.extract(rf"world=(?P<world>[^;]+);{number}=(?P<number>\d+)")
    return table.assign(world=parts["world"], **{number: parts["number"].astype(float)}).sort_values(
        number, kind="stable"
    )

"""Figure 5.9 as numbers: how often recoveries start nominal options outside nominal states, and the success there."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from p2l.chaining.novelty import SETS
from p2l.evaluation.rows import Row, table_of, trained_row
from p2l.evaluation.style import plain
from p2l.evaluation.thesis import Thesis

TABLE = "figure_5_9"
ANY = "any"
OUTSIDE, INSIDE = "#D55E00", "#0072B2"
COUNTS_AT = 1.04  # beside the axis of shares, where no interval is
NAMES = {"outside_visited": "where it is at work", "outside_begun": "where it begins"}


def figure_5_9(world: str, reuse: pd.DataFrame, thesis: Thesis) -> pd.DataFrame:
    """For every option, and `any`: `outside_<set>`, the share of its starts that are outside a set of nominal states;
    `pays_outside_<set>` and `pays_inside_<set>`, how many of those starts end with the task done.
    Intervals are `statistics.rate_interval`'s.

    Args:
        world: name of the item.
        reuse: rows of `p2l.chaining.reuse`, of all seeds; those without a handover do not count.
        thesis: for the column of its numbers.
    """
    rows: list[Row] = []
    for learner, whole in reuse[reuse["option"] != ""].groupby("learner", sort=False):
        for option in (*dict.fromkeys(whole["option"]), ANY):
            part = whole if option == ANY else whole[whole["option"] == option]
            for name in SETS:
                starts = part[part[f"off_{name}"].notna()]
                off = starts[f"off_{name}"].to_numpy(dtype=float) > 1.0
                success = starts["success"].to_numpy(dtype=bool)
                setting = f"world={world};option={option}"
                seeds, method = starts["seed"].to_numpy(), str(learner)
                rows.append(trained_row(method, setting, f"outside_{name}", off, seeds))
                rows.append(trained_row(method, setting, f"pays_outside_{name}", success[off], seeds[off]))
                rows.append(trained_row(method, setting, f"pays_inside_{name}", success[~off], seeds[~off]))
    return thesis.beside(table_of(rows), TABLE)


def novel_starts(table: pd.DataFrame, world: str, learner: str = "rc") -> Figure:
    """Left, how often options are started outside nominal execution's states; right, how often that succeeds.

    Args:
        table: of `figure_5_9`.
        world: whose options.
        learner: which learner's.
    """
    mine = table[(table["method"] == learner) & table["setting"].str.startswith(f"world={world};")]
    mine = mine.assign(option=mine["setting"].str.extract(r"option=(.*)")[0])
    options = list(dict.fromkeys(mine["option"]))
    figure = Figure(figsize=(8.2, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    for number, (metric, label) in enumerate(NAMES.items()):
        _points(
            left, mine[mine["metric"] == metric], options, 0.12 - 0.24 * number, ("#009E73", "#CC79A7")[number], label
        )
    for metric, label, colour, shift in (
        ("pays_outside_visited", "outside where it is at work", OUTSIDE, 0.12),
        ("pays_inside_visited", "inside", INSIDE, -0.12),
    ):
        _points(right, mine[mine["metric"] == metric], options, shift, colour, label)
    left.set(xlabel="share of starts outside the states …", xlim=(-0.02, 1.16))
    left.set_yticks(range(len(options)), [f"{option.replace('_', ' ')}" for option in options])
    left.set_ylim(max(len(options), 1) - 0.5, -0.5)
    right.set(xlabel="share of starts that end with the task done", xlim=(-0.02, 1.16))
    figure.suptitle(f"{world.replace('_', ' ')}: nominal options started by recoveries", fontsize=11)
    for axes in (left, right):
        plain(axes)
        axes.set_xticks(np.linspace(0.0, 1.0, 6))
        if options:
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=2, frameon=False, fontsize=8)
    return figure


def _points(axes: Axes, rows: pd.DataFrame, options: list[str], shift: float, colour: str, label: str) -> None:
    """Rates with their intervals and the number that they are of."""
    rows = rows[rows["n"] > 0]
    places = np.array([options.index(option) for option in rows["option"]], dtype=float) + shift
    mean, low, high = (rows[name].to_numpy(dtype=float) for name in ("mean", "low", "high"))
    axes.errorbar(mean, places, xerr=[mean - low, high - mean], fmt="o", color=colour, capsize=3, ms=5, label=label)
    for place, count in zip(places, rows["n"], strict=True):
        axes.annotate(f"n={count}", (COUNTS_AT, place), color=colour, fontsize=7, va="center")

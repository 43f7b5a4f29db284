"""Figures of a world's failure modes, in features and units that a person can read."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import rankdata

from p2l.evaluation.style import plain
from p2l.failures.clustering import Clustering
from p2l.failures.record import Failures
from p2l.records import Array, IntArray

# Paul Tol's muted colours, which colour-blind readers can tell apart; modes beyond them repeat with another marker.
COLOURS = ("#332288", "#CC6677", "#117733", "#DDCC77", "#88CCEE", "#AA4499", "#44AA99", "#999933", "#882255")
MARKERS = ("o", "s", "^", "D", "v", "P")
_KIND_COLOURS = ("#4477AA", "#EE6677", "#228833", "#CCBB44", "#66CCEE", "#AA3377", "#BBBBBB")
_UNITS = {"_m": ("cm", 100.0), "_rad": ("°", 180.0 / np.pi), "_n": ("N", 1.0), "_rad_s": ("rad/s", 1.0)}


def mode_colour(mode: int) -> str:
    """The colour of a mode in every figure."""
    return COLOURS[mode % len(COLOURS)]


def column_label(column: str) -> tuple[str, float]:
    """A feature's name with the unit of its axis, and the factor from SI to that unit."""
    name, index = re.fullmatch(r"(.*?)(?:\[(\d)\])?", column).groups()  # type: ignore[union-attr]
    axis = f" {'xyz'[int(index)]}" if index is not None and int(index) < 3 else f"[{index}]" if index else ""
    for suffix, (unit, factor) in sorted(_UNITS.items(), key=lambda entry: -len(entry[0])):
        if name.endswith(suffix):
            return f"{name.removesuffix(suffix).removesuffix('_pos').replace('_', ' ')}{axis}, {unit}", factor
    return f"{name.replace('_', ' ')}{axis}", 1.0


def mode_figure(clustering: Clustering, failures: Failures, table: pd.DataFrame, title: str) -> Figure:
    """Two scatters of the features that separate the modes best, their mean features, and their kinds of failure.

    Args:
        clustering: of the failures.
        failures: the training failures.
        table: rows of `tables.mode_table`.
        title: of the figure.
    """
    values = clustering.modes.features(failures.truth)
    order = feature_ranking(values, clustering.mode)
    figure = Figure(figsize=(12.0, 4.6 + 0.34 * len(table)), layout="constrained")
    figure.suptitle(title)
    grid = figure.add_gridspec(2, 2, height_ratios=(4.0, 0.6 + 0.34 * len(table)), width_ratios=(1.0, 1.0))
    for place, pair in enumerate(axes_of(clustering.modes.columns, order)):
        _scatter(figure.add_subplot(grid[0, place]), clustering, values, pair)
    _means(figure.add_subplot(grid[1, 0]), clustering, table)
    _kinds(figure.add_subplot(grid[1, 1]), failures, table)
    return figure


def feature_ranking(values: Array, mode: IntArray) -> list[int]:
    """Features [F] by the share of their ranks' variance that lies between modes, largest first.

    Ranks of tenths of a millimetre keep outliers and differences near zero from looking like separation.
    """
    ranks = np.asarray(rankdata(np.round(values, 4), axis=0))
    between = np.zeros(values.shape[1])
    for one in np.unique(mode):
        mine = mode == one
        between += mine.mean() * (ranks[mine].mean(axis=0) - ranks.mean(axis=0)) ** 2
    return [int(place) for place in np.argsort(-between, kind="stable")]


def axes_of(columns: Sequence[str], order: Sequence[int]) -> list[tuple[int, int]]:
    """Two pairs of features to plot, by rank; components of one vector go together.

    Args:
        columns: F names.
        order: features, as `feature_ranking` orders them.
    """
    rest = list(order)
    pairs = []
    for _ in range(2):
        one = rest.pop(0) if rest else order[0]
        vector = [place for place in rest if columns[place].split("[")[0] == columns[one].split("[")[0]]
        other = (vector or rest or [one])[0]
        rest = [place for place in rest if place != other]
        pairs.append((min(one, other), max(one, other)))
    return pairs


def _scatter(axes: Axes, clustering: Clustering, values: Array, pair: tuple[int, int]) -> None:
    labels, factors = zip(*(column_label(clustering.modes.columns[place]) for place in pair), strict=True)
    for mode, size in enumerate(clustering.modes.sizes.tolist()):
        mine = values[clustering.mode == mode][:, pair] * factors
        marker = MARKERS[(mode // len(COLOURS) + mode) % len(MARKERS)]
        style: dict[str, Any] = {"s": 16, "alpha": 0.7, "lw": 0, "color": mode_colour(mode), "marker": marker}
        axes.scatter(mine[:, 0], mine[:, 1], label=f"mode {mode} ({size})", **style)
    axes.set(xlabel=labels[0], ylabel=labels[1])
    plain(axes)
    axes.legend(frameon=False, fontsize=8, ncols=2)


def _means(axes: Axes, clustering: Clustering, table: pd.DataFrame) -> None:
    """Mean features: colour in standard deviations from the mean of all failures, number in units."""
    modes = clustering.modes
    labels, factors = zip(*(column_label(column) for column in modes.columns), strict=True)
    means = table[[f"mean:{column}" for column in modes.columns]].to_numpy(dtype=float)
    away = (means - modes.centre) / modes.spread
    axes.imshow(away, cmap="RdBu_r", vmin=-2.5, vmax=2.5, aspect="auto")
    for row, column in np.ndindex(*means.shape):
        text = f"{means[row, column] * factors[column] + 0.0:.1f}".replace("-0.0", "0.0")
        colour = "white" if abs(away[row, column]) > 1.5 else "black"
        axes.text(column, row, text, ha="center", va="center", fontsize=8, color=colour)
    axes.set_xticks(range(len(labels)), labels, rotation=25, ha="right", fontsize=8)
    axes.set_yticks(range(len(table)), [f"mode {mode}" for mode in table["mode"]], fontsize=8)
    axes.set_title("mean of each mode (colour: standard deviations from all failures)", fontsize=9)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)


def _kinds(axes: Axes, failures: Failures, table: pd.DataFrame) -> None:
    """The failures of each mode: kinds as parts of bars, the options that failed beside them."""
    offset = np.zeros(len(table))
    rows = np.arange(len(table))
    kinds = [kind for kind in failures.origin.kinds if table[f"kind:{kind}"].sum() > 0]
    for place, kind in enumerate(kinds):
        counts = (table[f"kind:{kind}"] * table["size"]).to_numpy(dtype=float)
        colour = _KIND_COLOURS[place % len(_KIND_COLOURS)]
        axes.barh(rows, counts, left=offset, color=colour, label=kind.replace("_", " "), height=0.7)
        offset += counts
    for row, record in enumerate(table.to_dict("records")):
        shares = {option: record[f"option:{option}"] for option in failures.origin.options}
        text = ", ".join(f"{share:.0%} {name.replace('_', ' ')}" for name, share in shares.items() if share >= 0.005)
        axes.annotate(text, (offset[row], row), xytext=(5, 0), textcoords="offset points", va="center", fontsize=7.5)
    axes.set_xlim(0.0, 1.9 * float(offset.max()))
    axes.set_ylim(len(table) - 0.4, -0.6)
    axes.set_yticks(rows, [f"mode {mode}" for mode in table["mode"]], fontsize=8)
    axes.set(xlabel="training failures; the option that failed is written beside the bar")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8, loc="lower right")

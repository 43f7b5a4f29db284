"""One look for all figures: a method keeps its name, colour and line everywhere; PNG bytes depend on the data alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.optimize import isotonic_regression

from p2l.records import Array

COST = "cost, units of effort"


@dataclass(frozen=True)
class MethodStyle:
    """How a method is drawn and named; colours are Okabe and Ito's, which colour-blind readers can tell apart."""

    label: str
    colour: str
    marker: str
    width: float = 1.5


METHODS: dict[str, MethodStyle] = {
    "adl": MethodStyle("ADL", "#0072B2", "o", 2.6),
    "ad": MethodStyle("AD", "#E69F00", "s"),
    "cba": MethodStyle("CBA(0.5)", "#D55E00", "^"),
    "cba_best": MethodStyle("CBA(best)", "#CC79A7", "v"),
    "alm": MethodStyle("ALM", "#009E73", "D"),
    "adl_any": MethodStyle("ADL, any order", "#56B4E9", "P"),
    "adl_true": MethodStyle("ADL, true transfer", "#555555", "X"),
}
THESIS_METHODS = ("adl", "ad", "cba", "cba_best", "alm")  # in the thesis's comparison


def png(figure: Figure, dpi: int = 150) -> bytes:
    """The figure as PNG, without the date and version that would change its bytes."""
    stream = BytesIO()
    figure.savefig(stream, format="png", dpi=dpi, metadata={"Software": None})
    return stream.getvalue()


def plain(axes: Axes) -> None:
    """No box around a plot, and a faint grid to read values by."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="y", color="0.92", lw=0.8)
    axes.set_axisbelow(True)


def label_ends(axes: Axes, ends: Sequence[tuple[float, float, str, str]], gap: float = 0.055) -> None:
    """Write labels to the right of where lines end, pushed apart to `gap` of the axes' height.

    Args:
        axes: with its final y limits.
        ends: (x, y, text, colour) of each line's last point.
        gap: smallest distance of two labels, share of the height.
    """
    low, high = axes.get_ylim()
    step = gap * (high - low)
    order = sorted(ends, key=lambda end: end[1])
    places = spread(np.array([end[1] for end in order]), step)
    for (x, y, text, colour), place in zip(order, places.tolist(), strict=True):
        axes.annotate(
            text,
            (x, y),
            xytext=(1.03, place),
            textcoords=axes.get_yaxis_transform(),
            color=colour,
            va="center",
            fontsize=9,
            arrowprops={"arrowstyle": "-", "color": colour, "lw": 0.6, "alpha": 0.7, "relpos": (0.0, 0.5)},
            annotation_clip=False,
        )


def spread(targets: Array, step: float) -> Array:
    """Places at least `step` apart whose squared distance to the sorted `targets` is smallest."""
    ranks = step * np.arange(len(targets))
    return np.asarray(isotonic_regression(targets - ranks).x + ranks, dtype=np.float64)

"""The figure of a predicted transfer table: expected success of every pair, what was tried, widths of intervals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from p2l.artifacts import atomic
from p2l.evaluation.style import png
from p2l.transfer.prediction import Prediction

_NAMED = 70  # tasks up to which each has its name on the axes
_LONGEST = 18  # letters of a name
_RING = "#D55E00"


def save_prediction_figure(path: Path, prediction: Prediction, level: float) -> None:
    """Draw it to a PNG, atomically."""
    figure = prediction_figure(prediction, level)
    with atomic(path) as temporary:
        temporary.write_bytes(png(figure, dpi=130))


def prediction_figure(prediction: Prediction, level: float) -> Figure:
    """Two squares, taught tasks down and tested tasks across: expected success, and the widths of the intervals."""
    m = len(prediction.names)
    side = float(np.clip(1.8 + 0.17 * m, 4.0, 11.5))
    figure = Figure(figsize=(2 * side + 2.0, side + 0.7), layout="constrained")
    left, right = figure.subplots(1, 2)
    panels = (
        (left, prediction.p, "viridis", "expected success probability"),
        (right, prediction.high - prediction.low, "magma", f"width of the {level:.0%} interval"),
    )
    for axes, values, colours, title in panels:
        image = axes.imshow(values, cmap=colours, vmin=0.0, vmax=1.0, interpolation="nearest")
        figure.colorbar(image, ax=axes, fraction=0.045, pad=0.02, label="probability")
        axes.set_title(title, fontsize=10)
        axes.set_xlabel("tested task")
        _name(axes, prediction.names)
    left.set_ylabel("taught task (whose lesson is used)")
    _mark(left, prediction, side)
    if len(prediction.tried):
        handles, labels = left.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(handles), fontsize=8, frameon=False)
    total = int(prediction.trials.sum())
    figure.suptitle(
        f"Transfer between {m} tasks – model {prediction.choice.model}, "
        f"{total} trials of {len(prediction.tried)} pairs",
        fontsize=11,
    )
    return figure


def _name(axes: Axes, names: tuple[str, ...]) -> None:
    m = len(names)
    if m > _NAMED:
        return
    short = [name if len(name) <= _LONGEST else name[: _LONGEST - 1] + "…" for name in names]
    size = float(np.clip(260 / m, 5.0, 8.0))
    axes.set_xticks(np.arange(m), short, rotation=90, fontsize=size, parse_math=False)
    axes.set_yticks(np.arange(m), short, fontsize=size, parse_math=False)
    axes.tick_params(length=2)


def _mark(axes: Axes, prediction: Prediction, side: float) -> None:
    """A ring on each tried pair, filled by its share of successes."""
    tried = prediction.tried
    if not len(tried):
        return
    share = tried.successes / tried.attempts
    size = (72.0 * (side - 1.8) / len(prediction.names) * 0.5) ** 2
    axes.scatter(
        tried.tested, tried.taught, c=share, s=size, cmap="gray", vmin=0.0, vmax=1.0, edgecolors=_RING, linewidths=1.0
    )
    for shade, label in (("white", "all succeeded"), ("0.5", "half succeeded"), ("black", "none succeeded")):
        axes.scatter([], [], s=40, c=shade, edgecolors=_RING, label=f"tried, {label}")

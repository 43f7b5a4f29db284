"""The reliability diagram of the transfer predictor."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from p2l.artifacts import atomic

COLOURS = ("#0b5fa5", "#d1495b", "#66a182", "#8d96a3")


def reliability_diagram(table: pd.DataFrame, methods: Sequence[str], domain: str, path: Path | str) -> None:
    """Success rate against predicted probability with Wilson intervals, over a histogram of the predictions.

    Args:
        table: rows of `fit.calibration_table`.
        methods: which of its methods, in drawing order; the first one stands out.
        domain: whose transfer is predicted; for the title.
        path: PNG to write.
    """
    figure = Figure(figsize=(5.0, 6.2), layout="constrained")
    grid = figure.add_gridspec(2, 1, height_ratios=(3, 1))
    above, below = figure.add_subplot(grid[0]), figure.add_subplot(grid[1])
    above.plot([0, 1], [0, 1], color="0.75", lw=1, zorder=0)
    for number, (method, colour) in enumerate(zip(methods, COLOURS, strict=False)):
        rows = table[(table["method"] == method) & (table["pairs"] > 0)]
        _curve(above, rows, method.replace("_", " "), colour, strong=number == 0)
        width = 0.8 * (rows["high_p"] - rows["low_p"]) / len(methods)
        below.bar(rows["low_p"] + (number + 0.6) * width, rows["pairs"], width, color=colour)
    above.set(xlim=(-0.02, 1.02), ylim=(-0.02, 1.02), ylabel="success rate (95 % Wilson interval)")
    above.set_title(f"{domain}: predicted and simulated transfer, held-out tasks")
    above.legend(frameon=False, loc="upper left")
    below.set(
        xlim=(-0.02, 1.02), yscale="log", ylim=(0.7, None), xlabel="predicted probability of success", ylabel="pairs"
    )
    for axes in (above, below):
        axes.spines[["top", "right"]].set_visible(False)
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=150, metadata={"Software": None})


def _curve(axes: Axes, rows: pd.DataFrame, label: str, colour: str, *, strong: bool) -> None:
    x, y, low, high = (np.asarray(rows[name], dtype=float) for name in ("mean_p", "rate", "low", "high"))
    spread = cast("list[float]", np.vstack([y - low, high - y]).clip(min=0.0))
    style = {"fmt": "o-", "ms": 5.0, "lw": 2.0} if strong else {"fmt": "s--", "ms": 3.0, "lw": 1.0}
    axes.errorbar(x, y, yerr=spread, color=colour, label=label, capsize=2, zorder=3 if strong else 2, **style)  # type: ignore[arg-type]

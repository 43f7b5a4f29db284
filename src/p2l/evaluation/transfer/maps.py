"""Transfer as heat maps: which taught skill solves which task, simulated and predicted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

from p2l.records import Array, IntArray, TransferData

WALL_FEATURES = tuple(f"wall_{side}_cm" for side in ("left", "right", "bottom", "top"))

Tick = tuple[float, str]


def transfer_maps(
    panels: Mapping[str, Array], rows: str, columns: str, row_ticks: Sequence[Tick], column_ticks: Sequence[Tick]
) -> Figure:
    """Matrices of success probabilities [K, M] side by side on one colour scale.

    Args:
        panels: title → matrix; all of one shape.
        rows: label of the rows' axis.
        columns: label of the columns' axis.
        row_ticks: (place, name) of each tick along the rows.
        column_ticks: the same along the columns.
    """
    shape = next(iter(panels.values())).shape
    height = float(np.clip(6.0 * shape[0] / shape[1], 2.4, 6.0))
    figure = Figure(figsize=(1.2 + 6.2 * len(panels), height + 0.9), layout="constrained")
    grid = figure.subplots(1, len(panels), squeeze=False, sharey=True)[0]
    for axes, (title, matrix) in zip(grid, panels.items(), strict=True):
        image = axes.imshow(matrix, cmap="cividis", vmin=0.0, vmax=1.0, aspect="auto", interpolation="nearest")
        axes.set_title(title, fontsize=10)
        axes.set_xlabel(columns)
        axes.set_yticks([place for place, _ in row_ticks], [name for _, name in row_ticks], fontsize=8)
        upright = 90 if len(column_ticks) > 6 else 0
        axes.set_xticks(
            [place for place, _ in column_ticks], [name for _, name in column_ticks], fontsize=8, rotation=upright
        )
    grid[0].set_ylabel(rows)
    figure.colorbar(image, ax=list(grid), label="probability of success", pad=0.01)
    return figure


def block_ticks(names: Sequence[str]) -> list[Tick]:
    """The middle of each run of equal names, with the name."""
    change = [0, *(index for index in range(1, len(names)) if names[index] != names[index - 1]), len(names)]
    return [((first + last - 1) / 2, names[first]) for first, last in pairwise(change) if names]


def task_order(data: TransferData) -> tuple[IntArray, list[str]]:
    """An order [M] of tasks in which like lie beside like, and the name of each task's kind in that order.

    Where features are distances to walls: by the nearest wall's side, then its distance; else by group.
    """
    walls = [index for index, name in enumerate(data.feature_names) if name in WALL_FEATURES]
    if not walls:
        order = np.argsort(data.group, kind="stable")
        return order, [data.names[index].partition("/")[0] for index in order]
    distances = data.features[:, walls]
    side = distances.argmin(axis=1)
    order = np.lexsort((distances.min(axis=1), side))
    return order, [f"{data.feature_names[walls[side[index]]].split('_')[1]} wall" for index in order]

"""Pictures of the insertion worlds: the four environments with their slots, and plans on the peg board."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Rectangle

from p2l.domains.insertion.layouts import CELL, CELLS, board_layout, grid_environments, grid_slots
from p2l.evaluation.team.look import COLOURS
from p2l.records import Array
from p2l.team.problem import Decision

HOLE_CM = 1.44  # drawn a little larger than the slot, for its number
NEAR_CM = 1.5  # holes of the row next to a wall are nearer to it than this
WALL_COLOUR = "#c9b48f"
MEANING = {Decision.LEARN: "learn (a lesson)", Decision.ACT: "act (robot)", Decision.DELEGATE: "delegate (person)"}
_EMPTY = "white"


def environments(layout_seed: int, farthest_wall_cm: float) -> Figure:
    """The four grid environments from above: walls, and the centres of all slots a task can have."""
    walls = grid_environments(layout_seed)
    figure = Figure(figsize=(3.1 * len(walls), 3.6), layout="constrained")
    half = 100.0 * CELL * CELLS / 2
    for number, (axes, layout) in enumerate(zip(figure.subplots(1, len(walls), sharey=True), walls, strict=True)):
        slots = 100.0 * grid_slots(layout, farthest_wall_cm)
        axes.scatter(*slots.T, s=7, marker="s", color="#4477AA", lw=0)
        _draw_walls(axes, layout)
        axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal", xlabel="x, cm")
        axes.set_title(f"environment {number}: {len(layout)} walls, {len(slots)} slots", fontsize=9)
    figure.axes[0].set_ylabel("y, cm")
    return figure


def board_plans(plans: pd.DataFrame, titles: Sequence[str]) -> Figure:
    """Plans on the board, one panel per order: holes by decision, arrows from a lesson to the tasks it serves.

    Args:
        plans: rows of one method's plans (`set`, `step`, `name`, `decision`, `task`, `skill`), all sets.
        titles: one per set.
    """
    columns = 2 if len(titles) > 1 else 1
    rows = -(-(len(titles) + 1) // columns)
    figure = Figure(figsize=(5.6 * columns, 3.5 * rows), layout="constrained")
    panels = np.ravel(figure.subplots(rows, columns, squeeze=False))
    for axes, title, (_, plan) in zip(panels, titles, plans.groupby("set", sort=True), strict=False):
        draw_board(axes, plan)
        axes.set_title(title, fontsize=10)
    for axes in panels[len(titles) :]:
        axes.set_axis_off()
    panels[len(titles)].legend(handles=decision_legend(), loc="center", frameon=False, fontsize=11)
    return figure


def draw_board(axes: Axes, plan: pd.DataFrame) -> None:
    """One plan on the board: holes by number and decision, arrows from each lesson to the attempts it serves."""
    walls, holes = board_layout()
    _draw_walls(axes, walls)
    place = {str(number): 100.0 * hole for number, hole in enumerate(holes)}
    decisions: Mapping[str, Decision] = {
        row["name"]: Decision[row["decision"].upper()] for row in plan.to_dict("records")
    }
    for name, (x, y) in place.items():
        task = name in decisions
        axes.add_artist(_hole(x, y, COLOURS[decisions[name]] if task else _EMPTY, strong=task))
        shade = "0.6" if not task else "black" if decisions[name] == Decision.DELEGATE else "white"
        axes.annotate(name, (x, y), ha="center", va="center", fontsize=8, color=shade, zorder=4)
    lessons = {row["task"]: place[row["name"]] for row in plan.to_dict("records") if row["decision"] == "learn"}
    for row in plan.to_dict("records"):
        if row["decision"] == "act" and row["skill"] in lessons:
            _serve(axes, lessons[row["skill"]], place[row["name"]])
    axes.set(xlim=(-27.0, 2.0), ylim=(-3.2, 13.8), aspect="equal")
    axes.set_axis_off()
    axes.plot([-26.0, -21.0], [12.5, 12.5], color="0.3", lw=2)
    axes.annotate("5 cm", (-23.5, 12.8), ha="center", va="bottom", fontsize=8, color="0.3")


def decision_legend() -> list[Line2D]:
    """Legend entries of the decisions, and of a hole without a task."""
    circle = {"marker": "s", "ls": "", "ms": 12, "markeredgecolor": "0.3"}
    entries = [Line2D([], [], color=COLOURS[kind], label=text, **circle) for kind, text in MEANING.items()]  # type: ignore[arg-type]
    return [*entries, Line2D([], [], color=_EMPTY, label="not among the tasks", **circle)]  # type: ignore[arg-type]


def _hole(x: float, y: float, colour: str, *, strong: bool) -> Rectangle:
    size = HOLE_CM
    edge = "0.2" if strong else "0.7"
    return Rectangle((x - size / 2, y - size / 2), size, size, facecolor=colour, edgecolor=edge, lw=0.8, zorder=3)


def _serve(axes: Axes, lesson: Array, task: Array) -> None:
    """An arrow beside the row of its task: over the wall to the near row, over the open board to the far one."""
    along = 0 if task[1] < -task[0] else 1  # bottom wall or right wall
    away = -0.5 if lesson[along] < task[along] else 0.5
    bend = -away if min(task[1], -task[0]) < NEAR_CM else away
    arrow = FancyArrowPatch(
        tuple(lesson),
        tuple(task),
        connectionstyle=f"arc3,rad={bend}",
        arrowstyle="-|>",
        mutation_scale=9,
        shrinkA=9,
        shrinkB=9,
        color=COLOURS[Decision.LEARN],
        alpha=0.75,
        lw=1.1,
        zorder=2,
    )
    axes.add_patch(arrow)


def _draw_walls(axes: Axes, walls: Array) -> None:
    for x, y, half_x, half_y in (100.0 * walls).tolist():
        axes.add_patch(Rectangle((x - half_x, y - half_y), 2 * half_x, 2 * half_y, color=WALL_COLOUR, lw=0, zorder=1))

"""One picture of what p2l does: the plan of a day's tasks, a plan on the peg board, and the planners' costs."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from p2l.evaluation.style import COST, THESIS_METHODS, plain
from p2l.evaluation.team.figures import cost_line, label_lines
from p2l.evaluation.team.layouts import decision_legend, draw_board
from p2l.evaluation.team.look import COLOURS
from p2l.team.problem import Decision

_ARCS = ("#882255", "#117733", "#332288", "#AA7700", "#007777", "#AA4499")  # one per lesson, in turn


def overview(day: pd.DataFrame, board: pd.DataFrame, summary: pd.DataFrame) -> Figure:
    """Three panels: a plan over time, a plan on the board, and cost against pre-training.

    Args:
        day: plan rows of one insertion set.
        board: plan rows of one order of the board.
        summary: `team_summary` rows of one regime.
    """
    figure = Figure(figsize=(12.0, 7.6), layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=(1, 1.25), width_ratios=(1.15, 1))
    top, left, right = figure.add_subplot(grid[0, :]), figure.add_subplot(grid[1, 0]), figure.add_subplot(grid[1, 1])
    draw_day(top, day)
    counts = day["decision"].value_counts()
    tally = ", ".join(f"{counts.get(kind, 0)} × {kind}" for kind in ("act", "delegate", "learn"))
    top.set_title(f"A day of {len(day)} insertions, planned: {tally}. Arcs: the attempts that a lesson pays for")
    draw_board(left, board)
    left.set_title("A plan on the peg board, between two walls")
    left.legend(handles=decision_legend(), loc="upper left", bbox_to_anchor=(0.05, 0.86), frameon=False, fontsize=9)
    for depth, method in enumerate(THESIS_METHODS):
        cost_line(right, summary, method, 10.0 - depth, prediction=False)
    right.set(xlabel="number of pre-trained skills", ylabel=f"executed {COST}", ylim=(0.0, None))
    right.set_title("What such a day costs, by planner (mean)")
    plain(right)
    label_lines(right)
    return figure


def draw_day(axes: Axes, day: pd.DataFrame) -> None:
    """Tasks in order of work, coloured by decision, with an arc from each lesson to the attempts it serves."""
    rows = day.sort_values("step").to_dict("records")
    lessons = {row["task"]: row["step"] for row in rows if row["decision"] == "learn"}
    shade = {task: _ARCS[rank % len(_ARCS)] for rank, task in enumerate(lessons)}
    angle = np.linspace(0.0, np.pi, 50)
    for row in rows:
        axes.scatter(row["step"], 0.0, marker="s", s=230, color=COLOURS[Decision[row["decision"].upper()]], zorder=3)
        if row["task"] in lessons:
            axes.scatter(row["step"], 0.0, marker="s", s=330, color=shade[row["task"]], zorder=2)
        if row["decision"] == "act" and row["skill"] in lessons:
            start, end = lessons[row["skill"]], row["step"]
            x = 0.5 * (start + end) - 0.5 * (end - start) * np.cos(angle)
            height = np.sqrt(abs(end - start) / len(rows))
            axes.plot(x, 0.1 + height * np.sin(angle), color=shade[row["skill"]], lw=1.6, alpha=0.85, zorder=1)
    axes.set(xlim=(-0.7, len(rows) - 0.3), ylim=(-0.16, 1.12), yticks=[])
    axes.set_xticks(range(len(rows)), [str(step + 1) for step in range(len(rows))], fontsize=9)
    axes.set_xlabel("task, in order of work")
    axes.tick_params(bottom=False)
    axes.spines[:].set_visible(False)

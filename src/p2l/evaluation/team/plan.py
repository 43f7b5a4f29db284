"""The figure of a plan: tasks in order of work, the decision and cost of each, and the tasks each lesson serves."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from p2l.artifacts import atomic
from p2l.evaluation.team.look import COLOURS, MEANING
from p2l.records import Array, IntArray
from p2l.team.problem import Decision, Plan, Problem

ARC_COLOURS = ("#882255", "#117733", "#332288", "#AA7700", "#007777", "#AA4499")  # one per lesson, in turn
NAME_LIMIT = 60  # up to so many tasks each has its name and a marker of its own
_LONGEST = 18  # letters of a task name


def save_plan_figure(path: Path | str, problem: Problem, plan: Plan) -> None:
    """Draw a plan to a PNG (or what the suffix says), atomically."""
    figure = plan_figure(problem, plan)
    with atomic(path) as temporary, warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from")  # drawn as a box; the CSV has the name
        figure.savefig(temporary, dpi=150)


def plan_figure(problem: Problem, plan: Plan) -> Figure:
    """The figure: arcs from each lesson to the attempts it serves above, the expected cost of each task below."""
    with_names = problem.n <= NAME_LIMIT
    figure = Figure(figsize=(float(np.clip(3.0 + 0.26 * problem.n, 7.0, 18.0)), 5.4), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    place = np.empty(problem.n, dtype=np.int64)
    place[plan.sequence] = np.arange(1, problem.n + 1)
    arcs = _draw_arcs(above, plan, place, with_names)
    _draw_tasks(above, plan, place, with_names)
    _draw_costs(below, problem, plan, place)
    below.set_xlim(0.3, problem.n + 0.7)
    if with_names:
        labels = [_short(problem.tasks[task]) for task in plan.sequence]
        dense = problem.n > 12 or max(map(len, labels)) > 60 // problem.n
        turn = 90 if dense else 0
        below.set_xticks(np.arange(1, problem.n + 1), labels, rotation=turn, fontsize=8, parse_math=False)
    below.set_xlabel(f"task, in order of work ({problem.order})")
    counts = ", ".join(f"{plan.count(kind)} {kind.name.lower()}" for kind in Decision)
    proof = "optimal" if plan.status == "optimal" else f"{plan.status}, gap {plan.gap:.2%}"
    above.set_title(f"Expected cost {plan.objective:,.1f} ({plan.planner}: {proof}) – {counts}", fontsize=10)
    handles: list[Patch | Line2D] = [Patch(color=COLOURS[kind], label=MEANING[kind]) for kind in Decision]
    handles.append(Patch(**failure_style(with_names), label="expected failure"))
    if arcs:
        handles.append(Line2D([], [], color=ARC_COLOURS[0], label="lesson pays for"))
    else:
        above.text(0.5, 0.5, "no lesson serves another task", transform=above.transAxes, ha="center", color="#666666")
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=8, frameon=False)
    return figure


def _draw_arcs(axes: Axes, plan: Plan, place: IntArray, with_names: bool) -> int:
    """Half circles squeezed to one height scale; returns how many there are."""
    lessons = plan.sequence[plan.decision[plan.sequence] == Decision.LEARN]
    colour = {int(lesson): ARC_COLOURS[rank % len(ARC_COLOURS)] for rank, lesson in enumerate(lessons)}
    users = np.flatnonzero((plan.decision == Decision.ACT) & (plan.skill >= 0))
    longest = max(1.0, float(np.abs(place[users] - place[plan.skill[users]]).max(initial=1)))
    lines = [arc(place[plan.skill[task]], place[task], longest) for task in users]
    shades = [colour[int(plan.skill[task])] for task in users]
    many = len(users) > 150
    axes.add_collection(
        LineCollection(lines, colors=shades, linewidths=0.4 if many else 1.2, alpha=0.35 if many else 0.8, zorder=1)
    )
    if with_names:
        axes.scatter(place[users], np.full(len(users), 0.035), marker="v", s=14, c=shades, zorder=4)
        axes.scatter(place[lessons], np.full(len(lessons), 0.0), marker="s", s=130, c=list(colour.values()), zorder=2)
    axes.set_ylim(-0.08, 1.08)
    axes.set_yticks([])
    axes.spines[["left", "right", "top", "bottom"]].set_visible(False)
    axes.tick_params(bottom=False, labelbottom=False)
    return len(users)


def arc(start: float, end: float, longest: float) -> Array:
    """[40, 2] a half circle from one place to another; the highest is that of the longest, with height 1."""
    angle = np.linspace(0.0, np.pi, 40)
    middle, radius = 0.5 * (start + end), 0.5 * (end - start)
    height = abs(end - start) / longest
    return np.stack([middle - radius * np.cos(angle), np.sqrt(height) * np.sin(angle)], axis=1)


def _draw_tasks(axes: Axes, plan: Plan, place: IntArray, with_names: bool) -> None:
    for kind in Decision:
        mine = place[plan.decision == kind]
        if with_names:
            axes.scatter(mine, np.zeros(len(mine)), marker="s", s=70, color=COLOURS[kind], zorder=3)
        else:
            axes.bar(mine, 0.06, bottom=-0.06, width=1.0, color=COLOURS[kind], zorder=3)


def _draw_costs(axes: Axes, problem: Problem, plan: Plan, place: IntArray) -> None:
    act = plan.decision == Decision.ACT
    certain = np.where(act, problem.c_rob, plan.expected_cost)
    width = 0.75 if problem.n <= NAME_LIMIT else 1.0
    for kind in Decision:
        mine = plan.decision == kind
        axes.bar(place[mine], certain[mine], width=width, color=COLOURS[kind])
    style = failure_style(problem.n <= NAME_LIMIT)
    axes.bar(place[act], (plan.expected_cost - certain)[act], bottom=certain[act], width=width, **style)
    axes.set_ylabel("expected cost\n(unit of the given costs)")
    axes.spines[["right", "top"]].set_visible(False)
    if problem.n <= 12:
        for task in range(problem.n):
            label = f"{plan.expected_cost[task]:,.0f}"
            axes.annotate(label, (place[task], plan.expected_cost[task]), ha="center", va="bottom", fontsize=8)
        axes.margins(y=0.15)


def failure_style(with_names: bool) -> dict[str, Any]:
    """How the expected cost of failures is drawn: hatched where bars are wide enough."""
    if not with_names:
        return {"color": "#A9C4DD"}
    return {"facecolor": "white", "edgecolor": COLOURS[Decision.ACT], "hatch": "////", "linewidth": 0.6}


def _short(name: str) -> str:
    return name if len(name) <= _LONGEST else name[: _LONGEST - 1] + "…"

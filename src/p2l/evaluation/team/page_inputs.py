"""What a plan was made from, as HTML: the limits, and folded tables of tasks, lessons and the order of work."""

from __future__ import annotations

import math

from p2l.evaluation.team.look import ORDER, UNIT, amount, limits
from p2l.evaluation.team.page_parts import NONE, header, listing, name, names, table
from p2l.team.shop.record import Ruling, Shop

_CHOICES = {
    Ruling.FREE: NONE, Ruling.ACT: "robot", Ruling.DELEGATE: "person", Ruling.LEARN: "taught",
    Ruling.NOT_LEARN: "not taught",
}  # fmt: skip
_CELLS = 6_000  # of a table; a larger one stays in the files that it was read from
_OPEN = 30  # lines up to which a table is not folded


def inputs(shop: Shop) -> str:
    """The limits and inputs of a day."""
    decided = int((shop.choice != Ruling.FREE).sum())
    lines = [
        ("tasks are done", ORDER[shop.order]),
        ("limits on lessons", ", ".join(limits(shop)) or "none"),
        ("tasks", f"{shop.n:,}" + (f", {int(shop.count.sum()):,} with all copies" if shop.count.max() > 1 else "")),
        ("robots", names(shop.robots)),
        ("lessons to choose from", f"{len(shop.lessons):,}"),
        ("decided beforehand", f"{decided:,} task{'' if decided == 1 else 's'}" if decided else "nothing"),
    ]
    parts = ["<dl>" + "".join(f"<dt>{term}</dt><dd>{text}</dd>" for term, text in lines) + "</dl>"]
    robots, count = len(shop.robots), len(shop.lessons)
    for title, length, cells, part in (
        ("Tasks", shop.n, shop.n * (4 + 3 * robots), _tasks),
        ("Lessons", count, count * (2 + robots), _lessons),
        ("Order that is kept", len(shop.arcs), 4 * len(shop.arcs), _order),
    ):
        if length and cells <= _CELLS:
            state = " open" if length <= _OPEN else ""
            parts.append(f"<details{state}><summary>{title} ({length:,})</summary>{part(shop)}</details>")
        elif length:
            parts.append(f"<p>{title} ({length:,}): too many to list here.</p>")
    return "\n".join(parts)


def _tasks(shop: Shop) -> str:
    """A line for each task: its copies, what is decided, the person's cost, and each robot's costs and skill."""
    several = len(shop.robots) > 1
    head = header("task") + header("copies", True) + header("decided") + header("person", True)
    for pupil in shop.robots:
        whose = f"{name(pupil)}: " if several else ""
        head += header(f"{whose}attempt", True) + header("failure", True) + header("success untaught", True)
    lines = []
    for place, task in enumerate(shop.tasks):
        cells = [f"{shop.count[place]:,}", _CHOICES[Ruling(int(shop.choice[place]))], _cost(shop.c_hum[place])]
        for robot in range(len(shop.robots)):
            cells += [_cost(shop.c_rob[robot, place]), _cost(shop.c_fail[robot, place])]
            cells.append(f"{shop.pretrained[robot, place]:.1%}")
        numbers = [
            f'<td class="number">{cell}</td>' if at != 1 else f"<td>{cell}</td>" for at, cell in enumerate(cells)
        ]
        lines.append(f'<tr><th scope="row">{name(task)}</th>{"".join(numbers)}</tr>')
    return table(f"Costs of one copy, in the {UNIT}; a dash: not possible, or not decided.", head, lines)


def _lessons(shop: Shop) -> str:
    """A line for each lesson: the task that it completes, and what it costs for each robot."""
    whose = [f"{name(robot)}: cost" for robot in shop.robots] if len(shop.robots) > 1 else ["cost"]
    head = header("lesson") + header("completes") + "".join(header(each, True) for each in whose)
    lines = []
    for place, lesson in enumerate(shop.lessons):
        own = int(shop.completes[place])
        costs = "".join(f'<td class="number">{_cost(cost)}</td>' for cost in shop.c_demo[:, place].tolist())
        completes = name(shop.tasks[own]) if own >= 0 else "no task of today"
        lines.append(f'<tr><th scope="row">{name(lesson)}</th><td>{completes}</td>{costs}</tr>')
    return table(f"Costs are in the {UNIT}; a dash: cannot be taught.", head, lines)


def _order(shop: Shop) -> str:
    return listing(f"{name(shop.tasks[first])} before {name(shop.tasks[then])}" for first, then in shop.arcs.tolist())


def _cost(value: float) -> str:
    return amount(float(value)) if math.isfinite(value) else NONE

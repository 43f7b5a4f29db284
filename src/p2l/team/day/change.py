"""What an outcome has changed: which tasks change hands, which lesson is new or dropped, what the day will cost."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from p2l.team.certificate import PROVEN
from p2l.team.day.record import Day
from p2l.team.day.steps import planned_step
from p2l.team.problem import Decision
from p2l.team.shop.outcome import attempt_cost
from p2l.team.shop.record import Shop
from p2l.text import printable

Way = tuple[Decision, int, int]  # decision, robot, lesson
_MOST = 6  # tasks that are named; the rest are counted


@dataclass(frozen=True)
class Move:
    """Copies of a task that change hands.

    Attributes:
        task: its number.
        copies: how many.
        was: how the plan before had them.
        now: how the plan after has them.
    """

    task: int
    copies: int
    was: Way
    now: Way


@dataclass(frozen=True)
class Change:
    """What one event has changed of the plan for the rest.

    Attributes:
        moves: tasks that change hands.
        new: lessons and robots that the plan has now, and had not.
        dropped: lessons and robots that it had, and has not.
        before: cost of the whole day that was expected before the event.
        kept: that is expected after it if the plan were kept; None if it cannot be.
        after: that is expected now.
    """

    moves: tuple[Move, ...]
    new: tuple[tuple[int, int], ...]
    dropped: tuple[tuple[int, int], ...]
    before: float
    kept: float | None
    after: float

    @property
    def is_none(self) -> bool:
        """Whether the plan for the rest is what it was."""
        return not (self.moves or self.new or self.dropped)


def change_of(before: Day, after: Day) -> Change:
    """What the last event of `after`, which `before` has not, has changed."""
    event = after.events[-1]
    was, now = _ways(before), _ways(after)
    step = planned_step(before, event.task) if event.copy else None
    if step is not None:
        was[event.task] = _less(was[event.task], (step.decision, step.robot, step.lesson))
    moves = []
    for task in sorted(set(was) | set(now)):
        gone, come = was.get(task, Counter()), now.get(task, Counter())
        lost, won = list((gone - come).elements()), list((come - gone).elements())
        pairs = Counter(zip(lost, won, strict=False))
        moves += [Move(task, copies, *pair) for pair, copies in pairs.items()]
    old = _lessons(before) - {(event.lesson, event.robot)}
    new = _lessons(after)
    kept = _cost_kept(after, was, old)
    return Change(
        tuple(moves), tuple(sorted(new - old)), tuple(sorted(old - new)), before.expected_total, kept,
        after.expected_total,
    )  # fmt: skip


def explain_change(shop: Shop, change: Change) -> str:
    """A change in words, one line for each kind; 'no change' if the plan is what it was."""
    costs = f"expected cost of the day {change.before:,.1f} -> {change.after:,.1f}"
    if change.is_none:
        return f"no change; {costs}" if _differ(change.before, change.after) else f"no change; {costs.split(' ->')[0]}"
    if change.kept is not None and _differ(change.kept, change.after):
        costs += f" ({change.kept:,.1f} if the plan were kept)"
    lines = [costs]
    for label, lessons in (("new lesson", change.new), ("dropped", change.dropped)):
        if lessons:
            lines.append(f"  {label}: {', '.join(_lesson(shop, *each) for each in lessons)}")
    for move in change.moves[:_MOST]:
        copies = f" ×{move.copies}" if move.copies > 1 else ""
        lines.append(f"  {_name(shop.tasks[move.task])}{copies}: {way(shop, move.was)} -> {way(shop, move.now)}")
    if len(change.moves) > _MOST:
        lines.append(f"  and {len(change.moves) - _MOST} more tasks change hands")
    return "\n".join(lines)


def way(shop: Shop, how: Way) -> str:
    """How a copy is done, in words."""
    decision, robot, lesson = how
    if decision == Decision.DELEGATE:
        return "the person"
    who = _name(shop.robots[robot])
    if decision == Decision.LEARN:
        return f"taught to {who}"
    return f"{who} by {'pre-trained skills' if lesson < 0 else 'the lesson on ' + _name(shop.lessons[lesson])}"


def _ways(day: Day) -> dict[int, Counter[Way]]:
    """How the plan has the copies that are left, by task."""
    ways: dict[int, Counter[Way]] = {}
    if day.rest is None or day.plan is None:
        return ways
    task, size = day.rest.shop.groups
    for group, (place, copies) in enumerate(zip(task.tolist(), size.tolist(), strict=True)):
        decision, robot = Decision(int(day.plan.decision[group])), int(day.plan.robot[group])
        lesson = int(day.plan.lesson[group])
        if lesson >= 0:
            lesson = int(day.rest.lesson[lesson])
        elif decision == Decision.ACT:
            lesson = int(day.rest.source[robot, place])
        ways.setdefault(int(day.rest.task[place]), Counter())[decision, robot, lesson] += copies
    return ways


def _cost_kept(day: Day, ways: dict[int, Counter[Way]], taught: set[tuple[int, int]]) -> float | None:
    """Expected cost of a day whose rest is done in given ways; None if a lesson of them was not given in time."""
    shop, costs = day.shop, [day.spent]
    known = {(each.lesson, each.robot): each.expected for each in day.standing.learnt}
    known |= {(lesson, robot): shop.transfer[robot, lesson] for lesson, robot in taught}
    known |= {(-1, robot): skill for robot, skill in enumerate(day.standing.pretrained)}
    costs += [float(shop.c_demo[robot, lesson]) for lesson, robot in taught]
    for task, counts in ways.items():
        for (decision, robot, lesson), copies in counts.items():
            if decision == Decision.DELEGATE:
                costs.append(copies * float(shop.c_hum[task]))
            elif decision == Decision.ACT:
                if (lesson, robot) not in known:
                    return None
                at = np.array([robot]), np.array([task])
                costs.append(copies * float(attempt_cost(shop, *at, known[lesson, robot][[task]])[0]))
    return math.fsum(costs)


def _less(ways: Counter[Way], done: Way) -> Counter[Way]:
    return +(ways - Counter([done]))


def _lessons(day: Day) -> set[tuple[int, int]]:
    if day.rest is None or day.plan is None:
        return set()
    return {(int(day.rest.lesson[lesson]), robot) for lesson, robot in day.plan.taught.tolist()}


def _lesson(shop: Shop, lesson: int, robot: int) -> str:
    to = f" to {_name(shop.robots[robot])}" if len(shop.robots) > 1 else ""
    return f"{_name(shop.lessons[lesson])}{to} ({shop.c_demo[robot, lesson]:,.1f})"


def _name(name: str) -> str:
    return printable(name, lines=False)


def _differ(one: float, other: float) -> bool:
    return abs(one - other) > PROVEN * max(1.0, abs(one))

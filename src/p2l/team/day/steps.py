"""What the plan of the rest does next, in the numbers of the morning's shop."""

from __future__ import annotations

from p2l.team.day.record import Day, Step
from p2l.team.problem import Decision


def next_step(day: Day) -> Step | None:
    """The step that comes next; None if nothing is left."""
    if day.rest is None or day.plan is None:
        return None
    for lesson, robot in day.plan.taught.tolist():
        if day.rest.shop.completes[lesson] < 0:
            number = int(day.rest.lesson[lesson])
            own = int(day.shop.completes[number]) if day.standing.shown == number else -1
            price = float(day.shop.c_demo[robot, number])
            return Step(own, 0, Decision.LEARN, robot, number, 1.0, price)
    return _step_of(day, int(day.plan.sequence[0]))


def planned_step(day: Day, task: int) -> Step | None:
    """What the plan does with the next copy of a task; None if all of them are done."""
    if day.rest is None or day.plan is None:
        return None
    group = day.rest.place_of_task.get(task)
    return None if group is None else _step_of(day, group)


def _step_of(day: Day, group: int) -> Step:
    """Of the first copy of a task that is left; groups of first copies have the numbers of their tasks."""
    assert day.rest is not None
    assert day.plan is not None
    plan, rest = day.plan, day.rest
    task, decision = int(rest.task[group]), Decision(int(plan.decision[group]))
    robot, lesson = int(plan.robot[group]), int(plan.lesson[group])
    if lesson >= 0:
        lesson = int(rest.lesson[lesson])
    elif decision == Decision.ACT:
        lesson = int(rest.source[robot, group])
    copy = int(day.standing.done[task]) + 1
    return Step(task, copy, decision, robot, lesson, float(plan.p_success[group]), float(plan.expected_cost[group]))

"""The plan before an event, carried on for what is left after it."""

from __future__ import annotations

import math

import numpy as np

from p2l.errors import ShapeError
from p2l.records import IntArray
from p2l.team.certificate import PROVEN
from p2l.team.day.record import Day, Event, EventOutcome
from p2l.team.day.remaining import Rest
from p2l.team.day.steps import next_step
from p2l.team.problem import Decision, relative_gap
from p2l.team.shop.outcome import ShopOutcome, shop_outcome
from p2l.team.shop.record import ShopPlan


def continued(day: Day, event: Event, rest: Rest) -> ShopPlan | None:
    """The plan before the event for what is left after it, its lessons and its order of work; None if it is no plan."""
    assert day.rest is not None
    assert day.plan is not None
    lessons, tasks = rest.place_of_lesson, rest.place_of_task
    taught = []
    for place, robot in day.plan.taught.tolist():
        lesson = lessons.get(int(day.rest.lesson[place]), -1)
        if lesson >= 0 and np.isfinite(rest.shop.c_demo[robot, lesson]):
            taught.append((lesson, robot))
    given = np.array(taught, dtype=np.int64).reshape(-1, 2)
    try:
        outcome = shop_outcome(rest.shop, given, _sequence(day, event, rest, tasks))
    except ShapeError:
        return None
    if not math.isfinite(outcome.total):
        return None
    return _plan_of(day, given, _sequence(day, event, rest, tasks), outcome)


def _sequence(day: Day, event: Event, rest: Rest, tasks: dict[int, int]) -> IntArray:
    """[G] groups of the rest in the order in which the plan had them."""
    assert day.rest is not None
    assert day.plan is not None
    old, _ = day.rest.shop.groups
    new, _ = rest.shop.groups
    others = {int(new[group]): group for group in range(rest.shop.n, len(new))}
    steps: list[int] = []
    for group in day.plan.sequence.tolist():
        task = int(day.rest.task[old[group]])
        place, is_first, is_done = tasks.get(task), group < day.rest.shop.n, event.copy > 0 and task == event.task
        if place is None or (is_done and is_first):
            continue
        if is_done or is_first:
            steps.append(place)
        if not is_first and place in others:
            steps.append(others[place])
    return np.array(steps, dtype=np.int64)


def _plan_of(day: Day, taught: IntArray, sequence: IntArray, outcome: ShopOutcome) -> ShopPlan:
    """A plan that is as good as the one that it is the rest of; no proof goes with it."""
    assert day.plan is not None
    spent = max(0.0, day.plan.objective - outcome.total)
    bound = min(outcome.total, max(0.0, day.plan.lower_bound - spent))
    gap = relative_gap(outcome.total, bound)
    return ShopPlan(
        planner=day.plan.planner, status="optimal" if gap <= PROVEN else "feasible", taught=taught, sequence=sequence,
        decision=outcome.decision, robot=outcome.robot, lesson=outcome.lesson, p_success=outcome.p_success,
        expected_cost=outcome.expected_cost, objective=outcome.total, lower_bound=bound,
        gap=gap, seconds=0.0,
    )  # fmt: skip


def is_settled(day: Day, event: Event, rest: Rest, kept: ShopPlan) -> bool:
    """Whether an optimal plan's step went as planned, and nothing is believed anew of what is left."""
    assert day.rest is not None
    assert day.plan is not None
    step = next_step(day)
    went = (event.task, event.copy, event.decision, event.robot, event.lesson)
    if step is None or kept.status != "optimal" or event.outcome == EventOutcome.NOT_TAUGHT:
        return False
    if went != (step.task, step.copy, step.decision, step.robot, step.lesson):
        return False
    places = [day.rest.place_of_task[each] for each in rest.task.tolist()]
    assumed = day.rest.shop.pretrained[:, places].copy()
    if event.decision == Decision.LEARN:
        lesson = day.rest.place_of_lesson[event.lesson]
        predicted = day.rest.shop.transfer[event.robot, lesson][places]
        assumed[event.robot] = np.maximum(assumed[event.robot], predicted)
    return bool(np.array_equal(assumed, rest.shop.pretrained))

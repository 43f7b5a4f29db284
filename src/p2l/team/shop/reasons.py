"""Why a plan of a shop is what it is: what each lesson saves, and what others would have to cost to be given.

The optimum is concave and piecewise linear in the cost of each lesson, with slope 1 where it is given and 0 where it is
not. So one more solution per lesson says all: a lesson that is given stays up to its cost plus what the optimum without
it costs more; one that is not given would be below what the optimum costs more than the one in which it is free.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np

from p2l.errors import ConfigError, ShapeError, SolverError
from p2l.records import IntArray
from p2l.team.shop.outcome import shop_outcome
from p2l.team.shop.planner import plan_shop
from p2l.team.shop.record import Shop, ShopPlan

SAME = 1e-9  # relative to the plan's cost: savings below it are rounding


@dataclass(frozen=True)
class LessonReason:
    """A lesson of the plan.

    Attributes:
        lesson: its number.
        robot: whom it is given to.
        c_demo: what it costs.
        serves: [S] groups that use it, without the one that it completes.
        saving: optimum without it minus the plan's cost; infinite where nothing can be done without it, NaN where there
            was no time to find out.
        saving_others_fixed: the same with all other lessons, and the order of work, as they are.
        stays_up_to: cost up to which an optimal plan has it; NaN where that is not known, and with `max_teaching`.
    """

    lesson: int
    robot: int
    c_demo: float
    serves: IntArray
    saving: float
    saving_others_fixed: float
    stays_up_to: float


@dataclass(frozen=True)
class BreakEven:
    """A lesson that can be given and is not: `below` this cost an optimal plan has it; 0 if it does not pay at all."""

    lesson: int
    robot: int
    c_demo: float
    below: float


@dataclass(frozen=True)
class Reasons:
    """Of a plan.

    Attributes:
        alone: optimum without any lesson; infinite where there is none.
        lessons: of the plan.
        not_given: lessons that a lower cost would bring into the plan, the one that is nearest to it first.
        unknown: lessons that there was no time for.
        without_limits: optimum without the limits on lessons, where they leave none; NaN if that was not asked for, or
            is not known.
    """

    alone: float
    lessons: tuple[LessonReason, ...]
    not_given: tuple[BreakEven, ...]
    unknown: int
    without_limits: float = math.nan


def reasons_of(shop: Shop, plan: ShopPlan, *, time_limit_s: float = 10.0) -> Reasons:
    """Solve the shop again without each lesson, and with each of the others that can be given for free.

    With `max_teaching`, a lesson's cost also counts against the limit: the dearer it is, the less is left for others.
    The optimum is then not concave in it, one more solution does not say up to where, and only savings are told.

    Args:
        shop: the day.
        plan: optimal, or nearly; savings are against its cost.
        time_limit_s: wall seconds for all of it.
    """
    deadline = time.perf_counter() + time_limit_s
    none = replace(shop, c_demo=np.full(shop.c_demo.shape, np.inf))
    alone = _optimum(none, deadline)
    lessons = [_lesson(shop, plan, lesson, robot, deadline) for lesson, robot in plan.taught.tolist()]
    unknown = sum(math.isnan(each.saving) for each in lessons)
    others: list[BreakEven] = []
    if tells_costs(shop):
        given = set(plan.taught[:, 0].tolist())
        can_teach = np.flatnonzero(np.isfinite(shop.c_demo).any(axis=0)).tolist()
        for lesson in (each for each in can_teach if each not in given):
            below = _below(shop, plan, lesson, deadline)
            if below is None:
                unknown += 1
            elif below.below > SAME * plan.objective:
                others.append(below)
    others.sort(key=lambda each: (each.c_demo - each.below, -each.below))
    free = math.nan
    if not lessons and shop.is_limited:
        free = _optimum(replace(shop, max_lessons=math.inf, max_teaching=math.inf), deadline)
    return Reasons(alone, tuple(lessons), tuple(others), unknown, free)


def tells_costs(shop: Shop) -> bool:
    """Whether it can be told up to which cost lessons are given."""
    return math.isinf(shop.max_teaching)


def _lesson(shop: Shop, plan: ShopPlan, lesson: int, robot: int, deadline: float) -> LessonReason:
    serves = np.flatnonzero((plan.lesson == lesson) & (plan.robot == robot) & (plan.decision == 0))
    rest = np.array([pair for pair in plan.taught.tolist() if pair != [lesson, robot]], dtype=np.int64).reshape(-1, 2)
    try:
        fixed = shop_outcome(shop, rest, plan.sequence).total - plan.objective
    except ShapeError:  # a person wants it taught
        fixed = math.inf
    c_demo = shop.c_demo.copy()
    c_demo[robot, lesson] = np.inf
    saving = _sound(_optimum(replace(shop, c_demo=c_demo), deadline) - plan.objective, plan)
    cost = float(shop.c_demo[robot, lesson])
    return LessonReason(lesson, robot, cost, serves, saving, fixed, cost + saving if tells_costs(shop) else math.nan)


def _below(shop: Shop, plan: ShopPlan, lesson: int, deadline: float) -> BreakEven | None:
    """For the robot to which it would be given first, of those to which it can be; None if there is no time."""
    best: BreakEven | None = None
    for robot in np.flatnonzero(np.isfinite(shop.c_demo[:, lesson])).tolist():
        c_demo = shop.c_demo.copy()
        c_demo[robot, lesson] = 0.0
        below = _sound(plan.objective - _optimum(replace(shop, c_demo=c_demo), deadline), plan)
        if math.isnan(below):
            return None
        if best is None or below - shop.c_demo[robot, lesson] > best.below - best.c_demo:
            best = BreakEven(lesson, robot, float(shop.c_demo[robot, lesson]), below)
    return best


def _sound(difference: float, plan: ShopPlan) -> float:
    return 0.0 if abs(difference) <= SAME * plan.objective else difference


def _optimum(shop: Shop, deadline: float) -> float:
    """Cost of an optimal plan; infinite if there is none, NaN if the time did not suffice."""
    left = deadline - time.perf_counter()
    if left <= 0.0:
        return math.nan
    try:
        plan = plan_shop(shop, time_limit_s=left)
    except ConfigError:
        return math.inf
    except SolverError:
        return math.nan
    return plan.objective if plan.status == "optimal" else math.nan

"""The two mixed integer programs of the thesis, in Pyomo: built here, solved in `p2l.team.mip.solve`.

Pyomo is the readable reference and the place for extensions (side constraints, budgets of lessons). It spends tens
of microseconds on every pair of tasks, so the large routes write the strong form as arrays
(`p2l.team.facility.program`). Which lesson serves which task, and at what cost, both take from theorem 3.4.1.

Deviations from the thesis:
1. Section 3.3.1 lets w_i count the taught skill on its own task, ρ_i(τ_i) x_i. Equation 3.1 charges a taught task
   c_demo alone, so its own entry in the maximum is x_i.
2. The maximum is linearised with one binary per argument: m_i is at least every argument and at most the one selected.
3. With a free order every lesson is an argument of every task's maximum (section 6.2.1).
4. What costs more than a plan that is known is left out, and costs are scaled: HiGHS's tolerances are absolute.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import pyomo.environ as pyo

from p2l.errors import SolverError
from p2l.records import Array, BoolArray
from p2l.team.facility import lesson_costs
from p2l.team.fallback import best_plan
from p2l.team.outcome import objective
from p2l.team.problem import Problem

_SEPARABLE = 1e7  # HiGHS cannot tell costs apart that differ by more than this factor
_SCALE = 10  # what a plan costs, as a power of two


class Usable(NamedTuple):
    """A problem's numbers, scaled, without what costs more than a plan that is known: no optimal plan contains it.

    Attributes:
        lessons: for each task, the lessons on others that come in time and are worth an attempt.
        service: [n, n] of each task (row) with each lesson.
        attempt, c_rob, c_hum, c_fail, c_demo: [n] as in `Problem`, scaled; infinite where it is left out.
    """

    lessons: list[list[int]]
    service: Array
    attempt: Array
    c_rob: Array
    c_hum: Array
    c_fail: Array
    c_demo: Array


def usable(problem: Problem) -> Usable:
    """What the programs are made of (see `Usable`)."""
    cost = objective(problem, best_plan(problem)).total
    limit = cost * (1.0 + 1e-12)
    scale = 2.0 ** min(1000, max(-1000, _SCALE - math.frexp(cost)[1])) if cost > 0.0 else 1.0

    def below(costs: Array) -> Array:
        return np.where(costs <= limit, np.minimum(costs, limit) * scale, np.inf)

    service, demo = below(lesson_costs(problem)), below(problem.c_demo)
    worth = np.isfinite(service) & np.isfinite(demo)
    np.fill_diagonal(worth, False)
    lessons = [np.flatnonzero(row).tolist() for row in worth]
    # An attempt that may fail at an infinite cost is left out, so that any cost serves for the others.
    with np.errstate(over="ignore"):  # what is infinite at this scale is refused by whoever builds the program
        c_fail = np.where(np.isinf(problem.c_fail), limit, problem.c_fail) * scale
    return Usable(lessons, service, below(problem.attempt), below(problem.c_rob), below(problem.c_hum), c_fail, demo)


def max_form(problem: Problem) -> Any:
    """The program of section 3.3.1 as a `pyo.ConcreteModel` with x (learn), y (delegate), w (intervention).

    Raises:
        SolverError: a failure costs so much more than a plan that HiGHS's tolerances cannot tell attempts apart.
    """
    numbers = usable(problem)
    model = pyo.ConcreteModel("act, delegate or learn: max form")
    model.tasks = pyo.RangeSet(0, problem.n - 1)
    model.x = pyo.Var(model.tasks, domain=pyo.Binary)
    model.y = pyo.Var(model.tasks, domain=pyo.Binary)
    model.w = pyo.Var(model.tasks, bounds=(0.0, 1.0))
    for i in model.tasks:
        _leave_out(model.x[i], numbers.c_demo[i])
        _leave_out(model.y[i], numbers.c_hum[i])
    # arguments of task i's maximum: -1 pre-trained, i itself taught, n delegated, and every lesson in time
    choices = [
        [*([-1] if np.isfinite(numbers.attempt[i]) else []), i, problem.n, *numbers.lessons[i]] for i in model.tasks
    ]
    attempts = [any(k not in (i, problem.n) for k in choices[i]) for i in model.tasks]
    for i in model.tasks:
        if attempts[i] and not numbers.c_fail[i] <= _SEPARABLE * 2.0**_SCALE:
            raise SolverError(
                f"max_form: a failure of task '{problem.tasks[i]}' costs more than {_SEPARABLE:g} times a whole plan, "
                "and HiGHS cannot tell numbers so far apart; use planner=auto"
            )
    model.arguments = pyo.Set(initialize=[(i, k) for i in model.tasks for k in choices[i]], dimen=2)
    model.select = pyo.Var(model.arguments, domain=pyo.Binary)

    def argument(i: int, k: int) -> Any:
        if k == -1:
            return float(problem.pretrained[i])
        if k == problem.n:
            return model.y[i]
        return model.x[i] if k == i else float(problem.transfer[k, i]) * model.x[k]

    model.one_action = pyo.Constraint(
        model.tasks, rule=lambda m, i: m.x[i] + m.y[i] <= 1 if attempts[i] else m.x[i] + m.y[i] == 1
    )
    model.at_least = pyo.Constraint(model.arguments, rule=lambda m, i, k: 1 - m.w[i] >= argument(i, k))
    model.at_most = pyo.Constraint(
        model.arguments, rule=lambda m, i, k: 1 - m.w[i] <= argument(i, k) + (1 - m.select[i, k])
    )
    model.one_maximum = pyo.Constraint(model.tasks, rule=lambda m, i: sum(m.select[i, k] for k in choices[i]) == 1)
    rob, fail = np.where(attempts, numbers.c_rob, 0.0).tolist(), np.where(attempts, numbers.c_fail, 0.0).tolist()
    hum, demo = (np.where(np.isfinite(cost), cost, 0.0).tolist() for cost in (numbers.c_hum, numbers.c_demo))
    model.cost = pyo.Objective(
        expr=sum(
            demo[i] * model.x[i] + hum[i] * model.y[i] + rob[i] * (1 - model.x[i] - model.y[i]) + fail[i] * model.w[i]
            for i in model.tasks
        )
    )
    return model


def strong_form(problem: Problem) -> Any:
    """The facility location program of section 3.4 with x (learn), y (delegate), r (attempt with ρ_0), serve (pairs).

    Every pair has its own linking row `serve <= x`, which makes the linear relaxation tight.
    """
    numbers = usable(problem)
    model = pyo.ConcreteModel("act, delegate or learn: strong form")
    model.tasks = pyo.RangeSet(0, problem.n - 1)
    lessons = numbers.lessons
    model.pairs = pyo.Set(initialize=[(j, i) for i in model.tasks for j in [i, *lessons[i]]], dimen=2)
    model.x = pyo.Var(model.tasks, domain=pyo.Binary)
    model.y = pyo.Var(model.tasks, bounds=(0.0, 1.0))
    model.r = pyo.Var(model.tasks, bounds=(0.0, 1.0))
    model.serve = pyo.Var(model.pairs, bounds=(0.0, 1.0))
    for i in model.tasks:
        _leave_out(model.x[i], numbers.c_demo[i])
        _leave_out(model.y[i], numbers.c_hum[i])
        _leave_out(model.r[i], numbers.attempt[i])
    model.done = pyo.Constraint(
        model.tasks, rule=lambda m, i: m.y[i] + m.r[i] + sum(m.serve[j, i] for j in [i, *lessons[i]]) == 1
    )

    model.link = pyo.Constraint(model.pairs, rule=lambda m, j, i: m.serve[j, i] <= m.x[j])
    costs = (numbers.c_hum, numbers.attempt, numbers.c_demo)
    hum, attempt, demo = (np.where(np.isfinite(cost), cost, 0.0).tolist() for cost in costs)
    service = numbers.service.tolist()
    model.cost = pyo.Objective(
        expr=sum(demo[i] * model.x[i] + hum[i] * model.y[i] + attempt[i] * model.r[i] for i in model.tasks)
        + sum(service[i][j] * model.serve[j, i] for j, i in model.pairs)
    )
    return model


def _leave_out(variable: Any, cost: float) -> None:
    if math.isinf(cost):
        variable.fix(0)


FORMS: Mapping[str, Callable[[Problem], Any]] = {"max_form": max_form, "strong": strong_form}


def lessons_of(model: Any) -> BoolArray:
    """[n] True where the solved model teaches the task."""
    return np.array([pyo.value(model.x[i]) > 0.5 for i in model.tasks])

"""The two mixed integer programs of the thesis, in Pyomo: built here, solved in `p2l.team.mip.solve`.

Pyomo is the readable reference and the place for extensions (side constraints, budgets of lessons). It spends tens
of microseconds on every pair of tasks, so the large routes write the strong form as arrays
(`p2l.team.facility.program`). Which lesson serves which task, and at what cost, both take from theorem 3.4.1.

Deviations from the thesis:
1. Section 3.3.1 lets w_i count the taught skill on its own task, ρ_i(τ_i) x_i. Equation 3.1 charges a taught task
   c_demo alone, so its own entry in the maximum is x_i.
2. The maximum is linearised with one binary per argument: m_i is at least every argument and at most the one selected.
3. With a free order every lesson is an argument of every task's maximum (section 6.2.1).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pyomo.environ as pyo

from p2l.records import BoolArray
from p2l.team.facility import lesson_costs
from p2l.team.problem import Problem


def helpers_of(problem: Problem) -> list[list[int]]:
    """For each task, the lessons that come in time for it (its own excluded)."""
    in_time = np.isfinite(lesson_costs(problem))
    np.fill_diagonal(in_time, False)
    return [np.flatnonzero(row).tolist() for row in in_time]


def max_form(problem: Problem) -> Any:
    """The program of section 3.3.1 as a `pyo.ConcreteModel` with x (learn), y (delegate), w (intervention)."""
    model = pyo.ConcreteModel("act, delegate or learn: max form")
    model.tasks = pyo.RangeSet(0, problem.n - 1)
    lessons = helpers_of(problem)
    # arguments of task i's maximum: -1 pre-trained, i itself taught, n delegated, and every lesson in time
    arguments = [(i, k) for i in model.tasks for k in [-1, i, problem.n, *lessons[i]]]
    model.arguments = pyo.Set(initialize=arguments, dimen=2)
    model.x = pyo.Var(model.tasks, domain=pyo.Binary)
    model.y = pyo.Var(model.tasks, domain=pyo.Binary)
    model.w = pyo.Var(model.tasks, bounds=(0.0, 1.0))
    model.select = pyo.Var(model.arguments, domain=pyo.Binary)

    def argument(i: int, k: int) -> Any:
        if k == -1:
            return float(problem.pretrained[i])
        if k == problem.n:
            return model.y[i]
        return model.x[i] if k == i else float(problem.transfer[k, i]) * model.x[k]

    model.one_action = pyo.Constraint(model.tasks, rule=lambda m, i: m.x[i] + m.y[i] <= 1)
    model.at_least = pyo.Constraint(model.arguments, rule=lambda m, i, k: 1 - m.w[i] >= argument(i, k))
    model.at_most = pyo.Constraint(
        model.arguments, rule=lambda m, i, k: 1 - m.w[i] <= argument(i, k) + (1 - m.select[i, k])
    )
    model.one_maximum = pyo.Constraint(
        model.tasks, rule=lambda m, i: sum(m.select[i, k] for k in [-1, i, problem.n, *lessons[i]]) == 1
    )
    rob, hum, fail, demo = (c.tolist() for c in (problem.c_rob, problem.c_hum, problem.c_fail, problem.c_demo))
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
    model = pyo.ConcreteModel("act, delegate or learn: strong form")
    model.tasks = pyo.RangeSet(0, problem.n - 1)
    lessons = helpers_of(problem)
    model.pairs = pyo.Set(initialize=[(j, i) for i in model.tasks for j in [i, *lessons[i]]], dimen=2)
    model.x = pyo.Var(model.tasks, domain=pyo.Binary)
    model.y = pyo.Var(model.tasks, bounds=(0.0, 1.0))
    model.r = pyo.Var(model.tasks, bounds=(0.0, 1.0))
    model.serve = pyo.Var(model.pairs, bounds=(0.0, 1.0))
    model.done = pyo.Constraint(
        model.tasks, rule=lambda m, i: m.y[i] + m.r[i] + sum(m.serve[j, i] for j in [i, *lessons[i]]) == 1
    )
    model.link = pyo.Constraint(model.pairs, rule=lambda m, j, i: m.serve[j, i] <= m.x[j])
    costs = (lesson_costs(problem), problem.c_hum, problem.attempt, problem.c_demo)
    service, hum, attempt, demo = (cost.tolist() for cost in costs)
    model.cost = pyo.Objective(
        expr=sum(demo[i] * model.x[i] + hum[i] * model.y[i] + attempt[i] * model.r[i] for i in model.tasks)
        + sum(service[i][j] * model.serve[j, i] for j, i in model.pairs)
    )
    return model


def lessons_of(model: Any) -> BoolArray:
    """[n] True where the solved model teaches the task."""
    return np.array([pyo.value(model.x[i]) > 0.5 for i in model.tasks])

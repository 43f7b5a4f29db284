"""Planners by HiGHS, in this process: the thesis's programs in Pyomo, and the strong form as arrays."""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import partial
from types import ModuleType

import numpy as np

from p2l.team import facility
from p2l.team.contract import Planner, PlannerResult, StoppingRule
from p2l.team.fallback import best_plan
from p2l.team.loading import loaded
from p2l.team.problem import Certificate, Problem

_MAKING = 0.4  # share of the time that making the instance may take, since checking takes as long
_CHECKING = 1.5  # times as long, to be safe


def pairs_in_time(problem: Problem, stop: StoppingRule) -> tuple[facility.Pairs, float]:
    """The facility location instance, and until when to solve it: the check will take as long as making it did.

    Raises:
        TimeoutError: making and checking it would take more than the time that there is.
    """
    start = time.perf_counter()
    pairs = facility.of_problem(problem, start + _MAKING * stop.seconds_left)
    return pairs, stop.deadline - _CHECKING * (time.perf_counter() - start)


def _mip() -> tuple[ModuleType, ModuleType]:
    from p2l.team.mip import model, solve

    return model, solve


def _pyomo(problem: Problem, stop: StoppingRule, form: str) -> PlannerResult:
    try:
        model, solve = loaded(_mip, stop.deadline)
        program = model.FORMS[form](problem)
        ending = solve.solve_model(program, deadline=stop.deadline, gap=stop.gap)
    except TimeoutError:
        return PlannerResult(best_plan(problem), complete=False)
    lessons = model.lessons_of(program) if ending.has_solution else None
    return PlannerResult(best_plan(problem, lessons, prune=not ending.complete), complete=ending.complete)


def _by_highs(problem: Problem, stop: StoppingRule) -> PlannerResult:
    try:
        pairs, deadline = pairs_in_time(problem, stop)
    except TimeoutError:
        return PlannerResult(best_plan(problem), complete=False)
    seconds_left = max(1e-3, deadline - time.perf_counter())
    solution = facility.solve_program(pairs, time_limit_s=seconds_left, gap=stop.gap)
    certificate = None
    if solution.multipliers is not None:
        certificate = Certificate.of(np.minimum(solution.multipliers, problem.outside))
    return PlannerResult(best_plan(problem, solution.open), solution.complete, certificate)


PROGRAMS: Mapping[str, Planner] = {
    "max_form": partial(_pyomo, form="max_form"),
    "strong": partial(_pyomo, form="strong"),
    "highs": _by_highs,
}

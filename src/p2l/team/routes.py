"""The planners themselves: functions from a problem and a stopping rule to a `PlannerResult`.

A route imports its solver when it is called, so that the room stays cheap to import. To add a planner, write one
function and one line in `PLANNERS`. Whatever a route says of bounds is checked (`p2l.team.certificate`), so it hands
over a certificate, or none.
"""

from __future__ import annotations

import numpy as np

from p2l.records import IntArray
from p2l.registry import Registry
from p2l.team import baselines, facility, oracle
from p2l.team.contract import Planner, PlannerResult, StoppingRule
from p2l.team.fallback import best_plan
from p2l.team.loading import loaded
from p2l.team.outcome import decide, objective
from p2l.team.problem import Certificate, Problem
from p2l.team.programs import PROGRAMS, pairs_in_time

# Up to so many tasks "auto" asks HiGHS for the relaxation, which takes milliseconds and is often integral; the compiled
# kernels load in 0.45 s, once per process. The size alone decides, so that a problem always goes the same way.
SMALL = 40
_STOPGAP = 0.15  # share of the time that is kept for a plan and a bound where HiGHS has none by then


def _in_time(problem: Problem, stop: StoppingRule, planner: str, largest: int) -> PlannerResult:
    """A planner by HiGHS; in a process of its own where HiGHS is seen to overrun its time limit, which is then kept."""
    if problem.n <= largest:
        return PROGRAMS[planner](problem, stop)
    from p2l.team.worker import plan_apart

    result = plan_apart(problem, planner, stop.deadline - _STOPGAP * stop.seconds_left, stop.gap)
    if result is not None and result.complete:
        return result
    instead = _approximation(problem, stop, "dual_ascent_lessons")
    better = result is None or _cost(problem, instead) < _cost(problem, result)
    return PlannerResult(instead.decision if better or result is None else result.decision, False, instead.certificate)


def _cost(problem: Problem, result: PlannerResult) -> float:
    return objective(problem, result.decision).total


def _max_form(problem: Problem, stop: StoppingRule) -> PlannerResult:
    return _in_time(problem, stop, "max_form", largest=40)


def _strong(problem: Problem, stop: StoppingRule) -> PlannerResult:
    return _in_time(problem, stop, "strong", largest=60)


def _by_facilities(problem: Problem, stop: StoppingRule, few: int) -> PlannerResult:
    try:
        pairs, deadline = pairs_in_time(problem, stop)
    except TimeoutError:
        return PlannerResult(best_plan(problem), complete=False)
    solution = facility.solve_small_or_large(pairs, deadline, stop.gap, few=few)
    lessons = solution.open if solution.complete or solution.open.any() else None
    return PlannerResult(best_plan(problem, lessons), solution.complete, solution.certificate)


def _facility(problem: Problem, stop: StoppingRule) -> PlannerResult:
    return _by_facilities(problem, stop, few=-1)


def _auto(problem: Problem, stop: StoppingRule) -> PlannerResult:
    return _by_facilities(problem, stop, few=problem.n**2 if problem.n <= SMALL else -1)


def _highs(problem: Problem, stop: StoppingRule) -> PlannerResult:
    return _in_time(problem, stop, "highs", largest=100)


def _approximation(problem: Problem, stop: StoppingRule, algorithm: str) -> PlannerResult:
    try:
        pairs, deadline = pairs_in_time(problem, stop)
        solve = getattr(loaded(facility.large_scale, deadline), algorithm)
    except TimeoutError:
        return PlannerResult(best_plan(problem))
    lessons, multipliers = solve(pairs, deadline)
    certificate = Certificate.of(np.minimum(multipliers, problem.outside))
    return PlannerResult(best_plan(problem, lessons, prune=True), certificate=certificate)


def _greedy(problem: Problem, stop: StoppingRule) -> PlannerResult:
    return _approximation(problem, stop, "greedy_lessons")


def _dual_ascent(problem: Problem, stop: StoppingRule) -> PlannerResult:
    return _approximation(problem, stop, "dual_ascent_lessons")


def _exhaustive(problem: Problem, stop: StoppingRule) -> PlannerResult:
    try:
        return PlannerResult(decide(problem, oracle.exhaustive(problem, stop.deadline)), complete=True)
    except TimeoutError:
        return PlannerResult(best_plan(problem), complete=False)


def _baseline(problem: Problem, decision: IntArray) -> PlannerResult:
    return PlannerResult(decision, sequence=np.arange(problem.n))


def _ad(problem: Problem, stop: StoppingRule) -> PlannerResult:  # noqa: ARG001
    return _baseline(problem, baselines.act_delegate(problem))


def _cba(problem: Problem, stop: StoppingRule, theta: float = 0.5) -> PlannerResult:  # noqa: ARG001
    return _baseline(problem, baselines.confidence_based(problem, theta))


def _alm(problem: Problem, stop: StoppingRule) -> PlannerResult:  # noqa: ARG001
    return _baseline(problem, baselines.act_learn_myopic(problem))


PLANNERS: Registry[Planner] = Registry(
    "planner",
    {
        "auto": lambda: _auto,
        "max_form": lambda: _max_form,
        "strong": lambda: _strong,
        "highs": lambda: _highs,
        "facility": lambda: _facility,
        "greedy": lambda: _greedy,
        "dual_ascent": lambda: _dual_ascent,
        "exhaustive": lambda: _exhaustive,
        "ad": lambda: _ad,
        "cba": lambda: _cba,
        "alm": lambda: _alm,
    },
)

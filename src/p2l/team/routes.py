"""The planners themselves: functions from a problem and a stopping rule to a `PlannerResult`.

A route imports its solver when it is called, so that the room stays cheap to import. To add a planner, write one
function and one line in `PLANNERS`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from p2l.records import Array, BoolArray, IntArray
from p2l.registry import Registry
from p2l.team import baselines, facility, oracle
from p2l.team.outcome import decide, objective
from p2l.team.problem import Problem, Status
from p2l.team.pruning import without_losses

# Up to so many tasks "auto" asks HiGHS, which answers in milliseconds; the compiled kernels load in 0.45 s, once per
# process. The size alone decides, so that a problem goes the same way in every process. Beyond, HiGHS would still save
# most of that where transfer is smooth, but where it is random it takes 21 s at n = 80 and the kernels 0.06 s.
SMALL = 40


@dataclass(frozen=True)
class StoppingRule:
    """When a planner may stop: the wall-clock `deadline` (of `time.perf_counter`) or a relative `gap`."""

    deadline: float
    gap: float

    @property
    def seconds_left(self) -> float:
        """Seconds until the deadline, never quite zero."""
        return max(1e-3, self.deadline - time.perf_counter())


@dataclass(frozen=True)
class PlannerResult:
    """What a planner comes back with.

    Attributes:
        decision: [n].
        status: how it ended; a proven bound turns "heuristic" into "optimal".
        lower_bound: proven, or -infinity when the planner has none.
        multipliers: [n] v of a Lagrangian bound, if there is one.
        sequence: [n] order of work; None for the natural one.
    """

    decision: IntArray
    status: Status
    lower_bound: float = -math.inf
    multipliers: Array | None = None
    sequence: IntArray | None = None


Planner = Callable[..., PlannerResult]  # of a Problem and a StoppingRule, and options of its own


def prepare(planner: str, problem: Problem) -> None:
    """Load the compiled kernels if the planner uses them, so that its time limit and its seconds are for planning."""
    if planner in ("facility", "greedy", "dual_ascent") or (planner == "auto" and problem.n > SMALL):
        facility.load_kernels()


def _best_plan(problem: Problem, lessons: BoolArray | None, *, proven: bool = False) -> IntArray:
    """The plan of these lessons, or the plan without lessons where that one is cheaper or there are none.

    Lessons that do not pay are dropped first, unless the lessons are proven best.
    """
    without = decide(problem, np.zeros(problem.n, dtype=bool))
    if lessons is None:
        return without
    decision = decide(problem, lessons if proven else without_losses(problem, lessons))
    return decision if objective(problem, decision).total <= objective(problem, without).total else without


def _pyomo(problem: Problem, program: Any, stop: StoppingRule) -> PlannerResult:
    from p2l.team.mip import model, solve

    ending = solve.solve_model(program, time_limit_s=stop.seconds_left, gap=stop.gap)
    lessons = model.lessons_of(program) if ending.has_solution else None
    decision = _best_plan(problem, lessons, proven=ending.complete and stop.gap == 0.0)
    return PlannerResult(decision, "optimal" if ending.complete else "time_limit", ending.lower_bound)


def _max_form(problem: Problem, stop: StoppingRule) -> PlannerResult:
    from p2l.team.mip.model import max_form

    return _pyomo(problem, max_form(problem), stop)


def _strong(problem: Problem, stop: StoppingRule) -> PlannerResult:
    from p2l.team.mip.model import strong_form

    return _pyomo(problem, strong_form(problem), stop)


def _highs(problem: Problem, stop: StoppingRule) -> PlannerResult:
    pairs = facility.of_problem(problem)
    solution = facility.solve_program(pairs, time_limit_s=stop.seconds_left, gap=stop.gap)
    decision = _best_plan(problem, solution.open, proven=solution.complete and stop.gap == 0.0)
    status: Status = "optimal" if solution.complete else "time_limit"
    return PlannerResult(decision, status, solution.lower_bound, solution.multipliers)


def _facility(problem: Problem, stop: StoppingRule) -> PlannerResult:
    solution = facility.solve_pairs(facility.of_problem(problem), deadline=stop.deadline, gap=stop.gap)
    decision = _best_plan(problem, solution.open, proven=solution.status == "optimal")
    return PlannerResult(decision, solution.status, solution.lower_bound, solution.multipliers)


def _greedy(problem: Problem, stop: StoppingRule) -> PlannerResult:  # noqa: ARG001
    lessons, multipliers = facility.greedy_solution(facility.of_problem(problem))
    return PlannerResult(_best_plan(problem, lessons), "heuristic", multipliers=multipliers)


def _dual_ascent(problem: Problem, stop: StoppingRule) -> PlannerResult:  # noqa: ARG001
    lessons, multipliers = facility.dual_ascent_solution(facility.of_problem(problem))
    return PlannerResult(_best_plan(problem, lessons), "heuristic", multipliers=multipliers)


def _auto(problem: Problem, stop: StoppingRule) -> PlannerResult:
    return _highs(problem, stop) if problem.n <= SMALL else _facility(problem, stop)


def _exhaustive(problem: Problem, stop: StoppingRule) -> PlannerResult:  # noqa: ARG001
    decision = decide(problem, oracle.exhaustive(problem))
    return PlannerResult(decision, "optimal", objective(problem, decision).total)


def _baseline(problem: Problem, decision: IntArray) -> PlannerResult:
    return PlannerResult(decision, "heuristic", sequence=np.arange(problem.n))


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

"""The planners themselves: functions from a problem and its limits to an `Answer`.

A route imports its solver when it is called, so that the room stays cheap to import. To add a planner, write one
function and one line in `PLANNERS`.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from p2l.records import Array, BoolArray, IntArray
from p2l.team import baselines, oracle
from p2l.team.outcome import decide, objective
from p2l.team.problem import Problem, Status
from p2l.team.pruning import without_losses

SMALL = 40  # up to so many tasks HiGHS answers in milliseconds
LOADING = 200  # up to so many it answers sooner than the compiled kernels load, where they are not loaded yet


@dataclass(frozen=True)
class Limits:
    """When a planner may stop: the wall-clock `deadline` (of `time.perf_counter`) or a relative `gap`."""

    deadline: float
    gap: float

    @property
    def left(self) -> float:
        """Seconds until the deadline, never quite zero."""
        return max(1e-3, self.deadline - time.perf_counter())


@dataclass(frozen=True)
class Answer:
    """What a planner found.

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


def prepare(planner: str, problem: Problem) -> None:
    """Load the compiled kernels if the planner uses them, so that its time limit and its seconds are for planning."""
    if planner in ("facility", "greedy", "dual_ascent") or (planner == "auto" and not _by_highs(problem)):
        from p2l.team.facility.solve import load_kernels

        load_kernels()


def _best_plan(problem: Problem, taught: BoolArray | None, *, proven: bool = False) -> IntArray:
    """The plan of these lessons, or the plan without lessons where that one is cheaper or there are none.

    Lessons that do not pay are dropped first, unless the lessons are proven best.
    """
    without = decide(problem, np.zeros(problem.n, dtype=bool))
    if taught is None:
        return without
    found = decide(problem, taught if proven else without_losses(problem, taught))
    return found if objective(problem, found).total <= objective(problem, without).total else without


def _pyomo(problem: Problem, limits: Limits, form: str) -> Answer:
    from p2l.team.mip import model, solve

    built = model.max_form(problem) if form == "max_form" else model.strong_form(problem)
    ending = solve.solve_model(built, time_limit_s=limits.left, gap=limits.gap)
    proven = ending.finished and limits.gap == 0.0
    decision = _best_plan(problem, model.taught_in(built) if ending.has_solution else None, proven=proven)
    return Answer(decision, "optimal" if ending.finished else "time_limit", ending.lower_bound)


def _max_form(problem: Problem, limits: Limits) -> Answer:
    return _pyomo(problem, limits, "max_form")


def _strong(problem: Problem, limits: Limits) -> Answer:
    return _pyomo(problem, limits, "strong")


def _highs(problem: Problem, limits: Limits) -> Answer:
    from p2l.team.facility.core import solve_core
    from p2l.team.facility.pairs import of_problem

    found = solve_core(of_problem(problem), time_limit_s=limits.left, gap=limits.gap)
    status: Status = "optimal" if found.finished else "time_limit"
    decision = _best_plan(problem, found.open, proven=found.finished and limits.gap == 0.0)
    return Answer(decision, status, found.lower_bound, found.multipliers)


def _facility(problem: Problem, limits: Limits) -> Answer:
    from p2l.team.facility.pairs import of_problem
    from p2l.team.facility.solve import solve_pairs

    found = solve_pairs(of_problem(problem), deadline=limits.deadline, gap=limits.gap)
    decision = _best_plan(problem, found.open, proven=found.status == "optimal")
    return Answer(decision, found.status, found.lower_bound, found.multipliers)


def _greedy(problem: Problem, limits: Limits) -> Answer:  # noqa: ARG001
    from p2l.team.facility.greedy import greedy
    from p2l.team.facility.pairs import of_problem

    opened, multipliers = greedy(of_problem(problem))
    return Answer(_best_plan(problem, opened), "heuristic", multipliers=multipliers)


def _dual_ascent(problem: Problem, limits: Limits) -> Answer:  # noqa: ARG001
    from p2l.team.facility.dual_ascent import dual_ascent
    from p2l.team.facility.local_search import columns_of, descend
    from p2l.team.facility.pairs import of_problem

    pairs = of_problem(problem)
    multipliers, opened = dual_ascent(pairs)
    opened = descend(pairs, columns_of(pairs), opened, opened)
    return Answer(_best_plan(problem, opened), "heuristic", multipliers=multipliers)


def _by_highs(problem: Problem) -> bool:
    return problem.n <= (SMALL if "p2l.team.facility.solve" in sys.modules else LOADING)


def _auto(problem: Problem, limits: Limits) -> Answer:
    return _highs(problem, limits) if _by_highs(problem) else _facility(problem, limits)


def _exhaustive(problem: Problem, limits: Limits) -> Answer:  # noqa: ARG001
    decision = decide(problem, oracle.exhaustive(problem))
    return Answer(decision, "optimal", objective(problem, decision).total)


def _baseline(problem: Problem, decision: IntArray) -> Answer:
    return Answer(decision, "heuristic", sequence=np.arange(problem.n))


def _ad(problem: Problem, limits: Limits) -> Answer:  # noqa: ARG001
    return _baseline(problem, baselines.act_delegate(problem))


def _cba(problem: Problem, limits: Limits, theta: float = 0.5) -> Answer:  # noqa: ARG001
    return _baseline(problem, baselines.confidence_based(problem, theta))


def _alm(problem: Problem, limits: Limits) -> Answer:  # noqa: ARG001
    return _baseline(problem, baselines.act_learn_myopic(problem))


PLANNERS: dict[str, Callable[..., Answer]] = {
    "auto": _auto,
    "max_form": _max_form,
    "strong": _strong,
    "highs": _highs,
    "facility": _facility,
    "greedy": _greedy,
    "dual_ascent": _dual_ascent,
    "exhaustive": _exhaustive,
    "ad": _ad,
    "cba": _cba,
    "alm": _alm,
}

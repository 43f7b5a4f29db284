"""One door to every planner: `plan(problem, planner=...)`.

Each planner is a function from a problem and its limits to an `Answer`; this module times it, recomputes the expected
costs from scratch and writes the `Plan`. A planner imports its solver when it is called, so that the room stays cheap
to import.
"""

from __future__ import annotations

import inspect
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from p2l.errors import ConfigError
from p2l.records import Array, BoolArray, IntArray
from p2l.team import baselines, oracle
from p2l.team.outcome import decide, objective, work_order
from p2l.team.problem import Certificate, Decision, Plan, Problem, Status, relative_gap

PROVEN = 1e-9  # relative gap at which cost and bound are the same number
TRUSTED = 1e-6  # relative gap up to which a solver that says "optimal" is believed: its feasibility tolerance


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


def plan(
    problem: Problem, planner: str = "auto", *, time_limit_s: float = 60.0, gap: float = 0.0, **options: Any
) -> Plan:
    """Decide for every task whether the robot acts, the person does it, or the person teaches it.

    Args:
        problem: the instance.
        planner: a name of `PLANNERS`.
        time_limit_s: wall seconds; at the limit the best plan so far is returned with its true bound.
        gap: relative gap at which an exact planner may stop; 0 proves optimality.
        **options: what the planner takes besides (`theta` for "cba").

    Raises:
        ConfigError: an unknown planner or option, a time limit of zero or less, a gap outside [0, 1).
        SolverError: the planner cannot treat this instance.
    """
    route = _route(planner, options)
    if not time_limit_s > 0.0:
        raise ConfigError(f"time_limit_s: {time_limit_s} given; it must be above 0")
    if not 0.0 <= gap < 1.0:
        raise ConfigError(f"gap: {gap} given; it is relative and must lie in [0, 1)")
    began = time.perf_counter()
    answer = route(problem, Limits(began + time_limit_s, gap), **options)
    return _written(problem, planner, answer, began)


def _route(planner: str, options: dict[str, Any]) -> Callable[..., Answer]:
    if planner not in PLANNERS:
        raise ConfigError(f"planner: '{planner}' is unknown; use one of {sorted(PLANNERS)}")
    route = PLANNERS[planner]
    allowed = set(inspect.signature(route).parameters) - {"problem", "limits"}
    if unknown := sorted(set(options) - allowed):
        raise ConfigError(f"planner '{planner}': unknown options {unknown}; it takes {sorted(allowed) or 'none'}")
    return route


def _written(problem: Problem, planner: str, answer: Answer, began: float) -> Plan:
    taught = answer.decision == Decision.LEARN
    sequence = work_order(problem, taught) if answer.sequence is None else answer.sequence
    outcome = objective(problem, answer.decision, sequence)
    cost = outcome.total
    bound = min(cost, max(answer.lower_bound, cheapest_conceivable(problem)))
    left = relative_gap(cost, bound)
    status = answer.status
    if left <= PROVEN:
        status = "optimal"
    elif status == "optimal" and left > TRUSTED:
        status = "feasible"
    proof = answer.multipliers
    certificate = None
    if proof is not None:
        from p2l.team.certificate import lagrangian_bound

        certificate = Certificate(proof, lagrangian_bound(problem, proof), cost)
    return Plan(
        planner=planner,
        status=status,
        sequence=sequence,
        decision=answer.decision,
        skill=outcome.skill,
        p_success=outcome.p_success,
        expected_cost=outcome.expected_cost,
        objective=cost,
        lower_bound=bound,
        gap=left,
        seconds=time.perf_counter() - began,
        certificate=certificate,
    )


def cheapest_conceivable(problem: Problem) -> float:
    """A bound that needs no solver: every task at its cheapest if every lesson were already given, for free."""
    best = np.maximum(problem.pretrained, problem.transfer.max(axis=0))
    attempt = problem.c_rob + (1.0 - best) * problem.c_fail
    return float(np.minimum(np.minimum(attempt, problem.c_hum), problem.c_demo).sum())


def _better(problem: Problem, taught: BoolArray | None) -> IntArray:
    """The plan of these lessons, or the plan without lessons where that one is cheaper or there are none."""
    without = decide(problem, np.zeros(problem.n, dtype=bool))
    if taught is None:
        return without
    found = decide(problem, taught)
    return found if objective(problem, found).total <= objective(problem, without).total else without


def _pyomo(problem: Problem, limits: Limits, form: str) -> Answer:
    from p2l.team import model, solve

    built = model.max_form(problem) if form == "max_form" else model.strong_form(problem)
    ending = solve.solve_model(built, time_limit_s=limits.left, gap=limits.gap)
    decision = _better(problem, model.taught_in(built) if ending.has_solution else None)
    return Answer(decision, "optimal" if ending.finished else "time_limit", ending.lower_bound)


def _max_form(problem: Problem, limits: Limits) -> Answer:
    return _pyomo(problem, limits, "max_form")


def _strong(problem: Problem, limits: Limits) -> Answer:
    return _pyomo(problem, limits, "strong")


def _highs(problem: Problem, limits: Limits) -> Answer:
    from p2l.team.core import solve_core
    from p2l.team.pairs import of_problem

    answer = solve_core(of_problem(problem), time_limit_s=limits.left, gap=limits.gap)
    return Answer(_better(problem, answer.open), "optimal" if answer.finished else "time_limit", answer.lower_bound)


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


def _auto(problem: Problem, limits: Limits) -> Answer:
    return _highs(problem, limits)


PLANNERS: dict[str, Callable[..., Answer]] = {
    "auto": _auto,
    "max_form": _max_form,
    "strong": _strong,
    "highs": _highs,
    "exhaustive": _exhaustive,
    "ad": _ad,
    "cba": _cba,
    "alm": _alm,
}

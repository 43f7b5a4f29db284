"""One door to every planner: `plan(problem, planner=...)`.

The route (`p2l.team.routes`) finds the decisions and a bound; this module checks the request, times it, recomputes the
expected costs from scratch and writes the `Plan`.
"""

from __future__ import annotations

import math
import time
from typing import Any, get_args

import numpy as np

from p2l.errors import ConfigError, SolverError
from p2l.team.certificate import lagrangian_bound
from p2l.team.outcome import objective, work_order
from p2l.team.problem import Certificate, Decision, Plan, Problem, Status, relative_gap
from p2l.team.routes import PLANNERS, PlannerResult, StoppingRule, prepare

PROVEN = 1e-9  # relative gap at which cost and bound are the same number
TRUST = 1e-6  # relative gap up to which a solver that says "optimal" is believed: its feasibility tolerance
CONTRADICTION = 1e-3  # relative to the cost, or to 1: a bound that far above the cost of a plan is no rounding


def plan(
    problem: Problem, planner: str = "auto", *, time_limit_s: float = 60.0, gap: float = 0.0, **options: Any
) -> Plan:
    """Decide for every task whether the robot acts, the person does it, or the person teaches it.

    Args:
        problem: the instance.
        planner: a name of `routes.PLANNERS`, or the target of a function of your own.
        time_limit_s: wall seconds; at the limit the best plan so far is returned with its true bound.
        gap: relative gap at which an exact planner may stop; 0 proves optimality.
        **options: what the planner takes besides (`theta` for "cba").

    Raises:
        ConfigError: an unknown planner or option, a time limit of zero or less, a gap outside [0, 1).
        SolverError: the planner cannot treat this instance, or what it comes back with contradicts itself.

    Example:
        Three tasks alike: one lesson (200) and two attempts (20 each) are cheaper than handing all to the person (300).

        >>> import numpy as np
        >>> from p2l import Decision, Problem, plan
        >>> c_rob, c_hum, c_fail, c_demo = (np.full(3, cost) for cost in (10.0, 100.0, 100.0, 200.0))
        >>> alike = np.full((3, 3), 0.9)
        >>> problem = Problem(("a", "b", "c"), c_rob, c_hum, c_fail, c_demo, np.zeros(3), alike)
        >>> day = plan(problem)
        >>> [Decision(decision).name for decision in day.decision], round(day.objective, 1)
        (['LEARN', 'ACT', 'ACT'], 240.0)
    """
    route = PLANNERS.factory_for(planner, options, own=2)
    if not time_limit_s > 0.0:
        raise ConfigError(f"time_limit_s: {time_limit_s} given; it must be above 0")
    if not 0.0 <= gap < 1.0:
        raise ConfigError(f"gap: {gap} given; it is relative and must lie in [0, 1)")
    prepare(planner, problem)
    start = time.perf_counter()
    result = PLANNERS.expect(planner, route(problem, StoppingRule(start + time_limit_s, gap), **options), PlannerResult)
    _check_result(problem, planner, result)
    return _plan(problem, planner, result, start)


def _check_result(problem: Problem, planner: str, result: PlannerResult) -> None:
    """Refuse what no plan can be made of, before anything is said to be proven by it."""
    if result.status not in get_args(Status):
        raise SolverError(f"planner '{planner}': status {result.status!r}; known: {', '.join(get_args(Status))}")
    for name, vector in (
        ("decision", result.decision),
        ("multipliers", result.multipliers),
        ("sequence", result.sequence),
    ):
        if vector is not None and np.shape(vector) != (problem.n,):
            raise SolverError(f"planner '{planner}': {name} has shape {np.shape(vector)}; there are {problem.n} tasks")
    if not np.isin(result.decision, list(Decision)).all():
        raise SolverError(f"planner '{planner}': a decision is none of {', '.join(each.name for each in Decision)}")
    if result.sequence is not None and not np.array_equal(np.sort(result.sequence), np.arange(problem.n)):
        raise SolverError(f"planner '{planner}': sequence is no order of the {problem.n} tasks")


def _plan(problem: Problem, planner: str, result: PlannerResult, start: float) -> Plan:
    lessons = result.decision == Decision.LEARN
    sequence = work_order(problem, lessons) if result.sequence is None else result.sequence
    outcome = objective(problem, result.decision, sequence)
    cost = outcome.total
    if result.lower_bound > cost + CONTRADICTION * max(1.0, abs(cost)):
        raise SolverError(
            f"planner '{planner}': says that no plan costs less than {result.lower_bound:g}; its own costs {cost:g}"
        )
    proven = [result.lower_bound, cheapest_conceivable(problem)]
    certificate = None
    if result.multipliers is not None:
        multipliers = np.minimum(result.multipliers, problem.outside)
        certificate = Certificate(multipliers, lagrangian_bound(problem, multipliers), cost)
        proven.append(certificate.bound)
    bound = min(cost, max(bound for bound in proven if not math.isnan(bound)))
    gap = relative_gap(cost, bound)
    status = result.status
    if gap <= PROVEN:
        status = "optimal"
    elif status == "optimal" and gap > TRUST:
        status = "feasible"
    return Plan(
        planner=planner,
        status=status,
        sequence=sequence,
        decision=result.decision,
        skill=outcome.skill,
        p_success=outcome.p_success,
        expected_cost=outcome.expected_cost,
        objective=cost,
        lower_bound=bound,
        gap=gap,
        seconds=time.perf_counter() - start,
        certificate=certificate,
    )


def cheapest_conceivable(problem: Problem) -> float:
    """A bound that needs no solver: every task at its cheapest if every lesson were already given, for free."""
    best = np.maximum(problem.pretrained, problem.transfer.max(axis=0))
    attempt = problem.c_rob + (1.0 - best) * problem.c_fail
    return float(np.minimum(np.minimum(attempt, problem.c_hum), problem.c_demo).sum())

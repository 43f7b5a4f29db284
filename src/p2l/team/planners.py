"""One door to every planner: `plan(problem, planner=...)`.

The route (`p2l.team.routes`) finds the decisions; this module checks the request, times it, recomputes the expected
costs from scratch, has the bound proven by `p2l.team.certificate`, and writes the `Plan`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, cast

import numpy as np

from p2l.errors import ConfigError, SolverError
from p2l.records import Array, BoolArray
from p2l.team import facility
from p2l.team.certificate import PROVEN, proven_bound
from p2l.team.contract import PlannerResult, StoppingRule, check_stopping
from p2l.team.loading import loaded
from p2l.team.outcome import objective, work_order
from p2l.team.problem import Certificate, Decision, Plan, Problem, Status, relative_gap
from p2l.team.routes import PLANNERS

_PROVABLE = 1_000  # tasks up to which a proof is looked for where a route has none
_FINISH = 0.1  # share of the time limit, at most, that is left for what comes after a route


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
    if not isinstance(problem, Problem):
        raise ConfigError(f"problem: given a {type(problem).__name__}; make a p2l.Problem, or read one from CSV files")
    route = PLANNERS.factory_for(planner, options, own=2)
    limit_s, gap = check_stopping(time_limit_s, gap)
    start = time.perf_counter()
    stop = StoppingRule(start + limit_s * (1.0 - _FINISH), gap)
    with PLANNERS.given(planner, route, options):
        made = route(problem, stop, **options)
    result = PLANNERS.expect(planner, made, PlannerResult)
    _check_result(problem, planner, result)
    return _plan(problem, planner, result, stop, start)


def _check_result(problem: Problem, planner: str, result: PlannerResult) -> None:
    """Refuse what no plan can be made of."""
    for name, vector in (("decision", result.decision), ("sequence", result.sequence)):
        if vector is not None and np.shape(vector) != (problem.n,):
            raise SolverError(f"planner '{planner}': {name} has shape {np.shape(vector)}; there are {problem.n} tasks")
    if not np.isin(result.decision, list(Decision)).all():
        raise SolverError(f"planner '{planner}': a decision is none of {', '.join(each.name for each in Decision)}")
    if result.sequence is not None and not np.array_equal(np.sort(result.sequence), np.arange(problem.n)):
        raise SolverError(f"planner '{planner}': sequence is no order of the {problem.n} tasks")
    if result.certificate is not None and not isinstance(result.certificate, Certificate):
        raise SolverError(f"planner '{planner}': certificate is a {type(result.certificate).__name__}, no Certificate")


def _plan(problem: Problem, planner: str, result: PlannerResult, stop: StoppingRule, start: float) -> Plan:
    lessons = np.asarray(result.decision) == Decision.LEARN
    sequence = work_order(problem, lessons) if result.sequence is None else result.sequence
    outcome = objective(problem, result.decision, sequence)
    cost = outcome.total
    if math.isinf(cost):
        task = problem.tasks[int(np.isinf(outcome.expected_cost).argmax())]
        raise SolverError(f"planner '{planner}': its plan does task '{task}' in a way that is not possible; try 'auto'")
    certificate, bound = _proof(problem, result, lessons, cost, stop)
    gap = relative_gap(cost, bound)
    status: Status = "heuristic" if result.complete is None else "feasible" if result.complete else "time_limit"
    return Plan(
        planner=planner,
        status="optimal" if gap <= PROVEN else status,
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


def _proof(
    problem: Problem, result: PlannerResult, lessons: BoolArray, cost: float, stop: StoppingRule
) -> tuple[Certificate, float]:
    """The certificate that proves most, and its bound.

    Where a route says that it has ended, and hands over no proof of that, the large-scale route looks for one.
    """
    certificates = [] if result.certificate is None else [result.certificate]
    bounds = [proven_bound(problem, each) for each in certificates]
    if result.certificate is None or problem.n <= _PROVABLE:
        multipliers = _cheapest_conceivable(problem)
        certificates.append(Certificate.of(multipliers))  # no lesson can beat any v_i, so that L(v) is their sum
        bounds.append(math.fsum(multipliers.tolist()) * (1.0 - PROVEN / 1000))
    unproven = result.complete and relative_gap(cost, max(bounds)) > max(PROVEN, stop.gap)
    if unproven and problem.n <= _PROVABLE and (solve_pairs := _large_scale(stop)) is not None:
        best = certificates[int(np.argmax(bounds))].multipliers[0]
        multipliers = np.minimum(best, problem.outside)
        solution = solve_pairs(
            facility.of_problem(problem),
            deadline=stop.deadline,
            gap=stop.gap,
            multipliers=multipliers,
            open_set=lessons,
        )
        certificates.append(solution.certificate)
        bounds.append(proven_bound(problem, solution.certificate))
    best_index = int(np.argmax(bounds))
    return certificates[best_index], min(cost, bounds[best_index])


def _large_scale(stop: StoppingRule) -> Callable[..., facility.PairsSolution] | None:
    try:
        return cast(Callable[..., facility.PairsSolution], loaded(facility.large_scale, stop.deadline).solve_pairs)
    except TimeoutError:
        return None


def _cheapest_conceivable(problem: Problem) -> Array:
    """[n] multipliers that need no solver: every task at its cheapest if every lesson were already given, for free."""
    attempt = problem.attempt_cost(np.maximum(problem.pretrained, problem.transfer.max(axis=0)))
    return np.minimum(np.minimum(attempt, problem.c_hum), problem.c_demo)

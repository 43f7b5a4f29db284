"""An independent check of a plan and of its lower bound: no solver, no pairs, only the problem's own numbers.

L(v) = Σ_i v_i + Σ_j min(0, f_j - Σ_i (v_i - c_ij)⁺) with v_i <= b_i is a lower bound on every plan, whatever v is:
relaxing "every task is done once" with prices v leaves each lesson to be judged alone. Where no single v says enough,
a certificate goes on to cases, a facility open or closed, each with its own v, and the bound is the lowest of theirs.
What no solution below the target can contain is left out of a case: a facility, or a pair, whose use alone would raise
L(v) to the target, or that costs as much by itself.

Rounding counts against the bound: what sums may have lost is taken off it, at the scale of the numbers summed. So
nothing has to be believed, neither a solver nor its tolerances, and only this check calls a plan optimal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast, get_args

import numpy as np

from p2l.errors import SolverError
from p2l.records import Array
from p2l.team.cases import Instance, tree_bound
from p2l.team.outcome import objective
from p2l.team.problem import Certificate, FacilitySolution, Plan, Problem, Status, relative_gap

PROVEN = 1e-9  # relative gap at which cost and bound are the same number
EXACT = 2.0**50  # whole numbers below it, and their sums, are exact


@dataclass(frozen=True)
class Verdict:
    """What the check recomputed: the plan's cost, the bound that is proven, and the relative gap between them."""

    cost: float
    bound: float
    gap: float

    @property
    def optimal(self) -> bool:
        """Whether no plan can be better by more than a billionth."""
        return self.gap <= PROVEN


def check_certificate(problem: Problem, plan: Plan) -> Verdict:
    """Recompute a plan from its decisions, and the bound from its certificate; refuse any claim that is not so.

    Raises:
        SolverError: the plan has no certificate, or a number or the status in it is not what the problem gives.

    Example:
        >>> import numpy as np
        >>> from p2l import Problem, check_certificate, plan
        >>> one = np.ones(1)
        >>> problem = Problem(("gear",), 10 * one, 100 * one, 100 * one, 200 * one, 0.95 * one, np.eye(1))
        >>> verdict = check_certificate(problem, plan(problem))
        >>> round(verdict.cost, 6), round(verdict.bound, 6)
        (15.0, 15.0)
    """
    if not isinstance(cast(object, plan), Plan) or not isinstance(cast(object, problem), Problem):
        raise SolverError(f"certificate: given {type(problem).__name__}, {type(plan).__name__}; expected Problem, Plan")
    if len(plan.decision) != problem.n:
        raise SolverError(f"certificate: a plan of {len(plan.decision)} tasks; the problem has {problem.n}")
    proof = _certificate_of(plan.certificate, problem.n)
    outcome = objective(problem, plan.decision, plan.sequence)
    for name in ("skill", "p_success", "expected_cost"):
        claim, truth = getattr(plan, name), getattr(outcome, name)
        scale = np.abs(truth) if name == "expected_cost" else 1.0
        so = claim == truth if name == "skill" else np.abs(claim - truth) <= PROVEN * scale
        if not bool(so.all()):
            task = int((~so).argmax())
            raise SolverError(
                f"certificate: {name} of task '{problem.tasks[task]}' is {claim[task]}, but the problem gives "
                f"{truth[task]}"
            )
    _agree("objective", plan.objective, outcome.total)
    verdict = Verdict(outcome.total, bound := proven_bound(problem, proof), relative_gap(outcome.total, bound))
    _refuse_claims(verdict, plan.lower_bound, plan.gap, plan.status)
    return verdict


def check_facility_location(opening_cost: Array, service_cost: Array, solution: FacilitySolution) -> Verdict:
    """Recompute a facility location solution's cost and its bound from opening_cost [F], service_cost [D, F].

    Raises:
        SolverError: no certificate, a demand served by a closed facility, or a claim that the costs do not give.
    """
    proof = _certificate_of(solution.certificate, len(service_cost))
    if not solution.open[solution.assignment].all():
        raise SolverError("certificate: a demand is assigned to a facility that is not open")
    service = service_cost[np.arange(len(service_cost)), solution.assignment]
    cost = math.fsum([*opening_cost[solution.open].tolist(), *service.tolist()])
    _agree("cost", solution.cost, cost)
    bound = proven_location_bound(opening_cost, service_cost, proof, cost)
    verdict = Verdict(cost, bound, relative_gap(cost, bound))
    _refuse_claims(verdict, solution.lower_bound, solution.gap, solution.status)
    return verdict


def proven_bound(problem: Problem, certificate: Certificate) -> float:
    """What no plan of a team problem costs less than, by its certificate.

    Raises:
        SolverError: a certificate that is no tree of cases, or not of this problem.
    """

    def block(low: int, high: int) -> Array:
        tasks, lessons = np.arange(low, high)[:, None], np.arange(problem.n)[None, :]
        cost = problem.attempt_cost(problem.transfer[:, low:high], slice(low, high)).T
        if problem.order == "fixed":
            cost = np.where(lessons < tasks, cost, np.inf)
        return np.where(lessons == tasks, 0.0, cost)

    return tree_bound(Instance(problem.c_demo, problem.outside, problem.tasks, block), certificate)


def proven_location_bound(opening_cost: Array, service_cost: Array, certificate: Certificate, cost: float) -> float:
    """What no solution of a facility location instance costs less than, by its certificate.

    A demand may be left outside for the cost of opening its cheapest facility for it alone: that loses no optimum.
    Where all costs that a solution below `cost` can use are whole numbers, so is its own cost, and the bound is rounded
    up to one.
    """
    outside = (service_cost + opening_cost).min(axis=1)
    names = tuple(f"demand {i}" for i in range(len(service_cost)))
    instance = Instance(opening_cost, outside, names, lambda low, high: service_cost[low:high])
    bound = tree_bound(instance, certificate)
    used = [opening_cost[opening_cost <= cost], service_cost[service_cost <= cost]]
    whole = cost < EXACT and all(bool((part == np.floor(part)).all()) for part in used)
    return float(math.ceil(bound)) if whole else bound


def lagrangian_bound(problem: Problem, multipliers: Array) -> float:
    """L(v) of a team problem, from scratch, rounding counted against it; multipliers [n] above b_i are cut to b_i."""
    return proven_bound(problem, Certificate.of(np.minimum(multipliers, problem.outside)))


def _certificate_of(certificate: Certificate | None, demands: int) -> Certificate:
    if certificate is None:
        raise SolverError("certificate: none given; plan with 'auto', 'facility', 'highs', 'greedy' or 'dual_ascent'")
    if certificate.multipliers.shape[1] != demands:
        raise SolverError(f"certificate: {certificate.multipliers.shape[1]} multipliers given; expected {demands}")
    return certificate


def _refuse_claims(verdict: Verdict, lower_bound: float, gap: float, status: Status) -> None:
    if not verdict.bound <= verdict.cost * (1.0 + PROVEN):
        raise SolverError(
            f"certificate: proves that nothing costs less than {verdict.bound}; this costs {verdict.cost}"
        )
    if status not in get_args(Status):
        raise SolverError(f"certificate: status {status!r} is unknown; known: {', '.join(get_args(Status))}")
    if not lower_bound <= verdict.bound + PROVEN * abs(verdict.cost):  # NaN is refused, too
        raise SolverError(f"certificate: lower_bound is {lower_bound}, but {verdict.bound} is proven")
    if not abs(gap - relative_gap(verdict.cost, lower_bound)) <= PROVEN:
        raise SolverError(
            f"certificate: gap is {gap}, but cost and bound give {relative_gap(verdict.cost, lower_bound)}"
        )
    if (status == "optimal") != (gap <= PROVEN) or (status == "optimal" and verdict.gap > 1.01 * PROVEN):
        raise SolverError(f"certificate: status is '{status}', but a gap of {verdict.gap:.2g} is proven")


def _agree(what: str, claim: float, truth: float) -> None:
    if not abs(claim - truth) <= PROVEN * abs(truth):
        raise SolverError(f"certificate: {what} is {claim}, but the problem gives {truth}")

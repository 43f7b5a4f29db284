"""An independent check of a plan and of its lower bound: no solver, no pairs, only the problem's own numbers.

L(v) = Σ_i v_i + Σ_j min(0, f_j - Σ_i (v_i - c_ij)⁺) with v_i <= b_i is a lower bound on every plan, whatever v is:
relaxing "every task is done once" with prices v leaves each lesson to be judged alone. A bound beyond L(v) is the word
of a branch and bound tree; `Verdict.gap` is what the multipliers alone prove.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p2l.errors import SolverError
from p2l.records import Array
from p2l.team.outcome import objective
from p2l.team.problem import Certificate, FacilitySolution, Plan, Problem, relative_gap

_TOLERANCE = 1e-9  # relative: what rounding may change
_BLOCK = 4_000_000  # entries of the cost table that are looked at together


@dataclass(frozen=True)
class Verdict:
    """What the check recomputed: the plan's cost, the bound L(v), and the relative gap between them."""

    cost: float
    bound: float
    gap: float


def check_certificate(problem: Problem, plan: Plan) -> Verdict:
    """Recompute a plan's costs and its certificate from the problem.

    Raises:
        SolverError: the plan has no certificate, or a number in it is not what the problem says.

    Example:
        >>> import numpy as np
        >>> from p2l import Problem, check_certificate, plan
        >>> one = np.ones(1)
        >>> problem = Problem(("gear",), 10 * one, 100 * one, 100 * one, 200 * one, 0.95 * one, np.eye(1))
        >>> verdict = check_certificate(problem, plan(problem))
        >>> round(verdict.cost, 6), round(verdict.bound, 6)
        (15.0, 15.0)
    """
    proof = _certificate_of(plan.certificate, problem.n)
    outcome = objective(problem, plan.decision, plan.sequence)
    _agree("expected_cost", float(np.abs(outcome.expected_cost - plan.expected_cost).max()), 0.0, outcome.total)
    _agree("objective", plan.objective, outcome.total, outcome.total)
    return _verdict(proof, plan.objective, plan.lower_bound, lagrangian_bound(problem, proof.multipliers, strict=True))


def check_facility_location(opening_cost: Array, service_cost: Array, solution: FacilitySolution) -> Verdict:
    """Recompute a facility location solution's cost and its certificate from opening_cost [F], service_cost [D, F].

    Raises:
        SolverError: no certificate, a demand served by a closed facility, or a number that the costs do not give.
    """
    proof = _certificate_of(solution.certificate, len(service_cost))
    if not solution.open[solution.assignment].all():
        raise SolverError("certificate: a demand is assigned to a facility that is not open")
    service = service_cost[np.arange(len(service_cost)), solution.assignment]
    _agree("cost", solution.cost, float(opening_cost[solution.open].sum() + service.sum()), solution.cost)
    v = proof.multipliers
    saving = np.concatenate(
        [
            np.maximum(v[:, None] - service_cost[:, low : low + 1000], 0.0).sum(axis=0)
            for low in range(0, len(opening_cost), 1000)
        ]
    )
    bound = float(v.sum() + np.minimum(0.0, opening_cost - saving).sum())
    return _verdict(proof, solution.cost, solution.lower_bound, bound)


def lagrangian_bound(problem: Problem, multipliers: Array, *, strict: bool = False) -> float:
    """L(v) of a team problem, from scratch; multipliers [n] above b_i are cut to b_i, or refused if `strict`."""
    v = np.minimum(multipliers, problem.outside)
    if strict and (multipliers > problem.outside * (1.0 + _TOLERANCE)).any():
        task = int((multipliers - problem.outside).argmax())
        raise SolverError(f"certificate: multiplier of task '{problem.tasks[task]}' is above its outside option")
    saving = np.zeros(problem.n)
    step = max(1, _BLOCK // problem.n)
    task_index = np.arange(problem.n)
    for low in range(0, problem.n, step):
        lessons = np.arange(low, min(problem.n, low + step))
        margin = np.maximum(v - problem.service_cost(lessons), 0.0)
        if problem.order == "fixed":
            margin[task_index[None, :] < lessons[:, None]] = 0.0
        margin[lessons - low, lessons] = np.maximum(v[lessons], 0.0)
        saving[lessons] = margin.sum(axis=1)
    return float(v.sum() + np.minimum(0.0, problem.c_demo - saving).sum())


def _certificate_of(certificate: Certificate | None, demands: int) -> Certificate:
    if certificate is None:
        raise SolverError("certificate: none given; plan with 'auto', 'facility', 'highs', 'greedy' or 'dual_ascent'")
    if len(certificate.multipliers) != demands:
        raise SolverError(f"certificate: {len(certificate.multipliers)} multipliers given; expected {demands}")
    return certificate


def _verdict(proof: Certificate, cost: float, lower_bound: float, bound: float) -> Verdict:
    _agree("certificate.cost", proof.cost, cost, cost)
    _agree("certificate.bound", proof.bound, bound, cost)
    if lower_bound > cost * (1.0 + _TOLERANCE) or bound > cost * (1.0 + _TOLERANCE):
        raise SolverError(f"certificate: a lower bound ({max(lower_bound, bound)}) exceeds the cost ({cost})")
    return Verdict(cost, bound, relative_gap(cost, bound))


def _agree(what: str, claim: float, truth: float, scale: float) -> None:
    if not abs(claim - truth) <= _TOLERANCE * max(abs(scale), abs(truth)):
        raise SolverError(f"certificate: {what} is {claim}, but the problem gives {truth}")

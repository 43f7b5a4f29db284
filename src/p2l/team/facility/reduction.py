"""Theorem 3.4.1: an Act, Delegate or Learn problem is an uncapacitated facility location problem, and back.

Deviations from the thesis's proof:
1. The pre-trained skills are one more facility, open for free; without it an untaught, undelegated task could only be
   served at the big M. Hence 2n + 1 facilities.
2. The facility of a lesson serves its own task at 0, since the demonstration completes it (equation 3.1).
3. With a free order (section 6.2.1) a lesson serves every task, not only the subsequent ones.
4. M exceeds every cost of the instance, so it is never paid: the pre-trained facility is cheaper.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p2l.records import Array, BoolArray, IntArray
from p2l.team.problem import Decision, Problem


@dataclass(frozen=True)
class FacilityInstance:
    """Facilities in the order: n delegate, n learn, one pre-trained.

    Attributes:
        opening_cost: [2n + 1].
        service_cost: [n, 2n + 1], demand by facility.
    """

    opening_cost: Array
    service_cost: Array


def to_facility_location(problem: Problem) -> FacilityInstance:
    """The facility location instance of Theorem 3.4.1, equal in optimum to `problem`."""
    n = problem.n
    big = 1.0 + float((problem.c_rob + problem.c_fail + problem.c_hum).max())
    delegate = np.full((n, n), big)
    np.fill_diagonal(delegate, 0.0)
    learn = lesson_costs(problem)
    learn[~np.isfinite(learn)] = big
    opening = np.concatenate([problem.c_hum, problem.c_demo, [0.0]])
    service = np.concatenate([delegate, learn.T, problem.attempt[:, None]], axis=1)
    return FacilityInstance(opening_cost=opening, service_cost=service)


def lesson_costs(problem: Problem) -> Array:
    """[n, n] what a task (column) costs with the lesson of a task (row); infinite where the lesson comes too late."""
    cost = problem.served(slice(None))
    if problem.order == "fixed":
        cost[np.tril_indices(problem.n, -1)] = np.inf
    np.fill_diagonal(cost, 0.0)
    return cost


def to_decisions(problem: Problem, opened: BoolArray) -> IntArray:
    """[n] the plan behind a set of open facilities [2n + 1].

    A delegate facility that opens beside its own lesson adds nothing and is dropped; every other choice is kept, so
    the plan costs at most what the open set costs.
    """
    handed, taught = opened[: problem.n], opened[problem.n : 2 * problem.n]
    decision = np.where(taught, Decision.LEARN, np.where(handed, Decision.DELEGATE, Decision.ACT))
    return decision.astype(np.int64)


def to_open(decision: IntArray) -> BoolArray:
    """[2n + 1] the open set behind a plan; its facility location cost is the plan's expected cost."""
    return np.concatenate([decision == Decision.DELEGATE, decision == Decision.LEARN, [True]])


def facility_cost(opening_cost: Array, service_cost: Array, opened: BoolArray) -> float:
    """Equation 3.3, from scratch: opening [F] plus cheapest service [D, F]; infinite when nothing is open."""
    if not opened.any():
        return float("inf")
    return float(opening_cost[opened].sum() + service_cost[:, opened].min(axis=1).sum())

"""Theorem 3.4.1: an Act, Delegate or Learn problem is an uncapacitated facility location problem.

Every task is a demand and the lesson on it a facility, opened for c_demo. The open facilities of a solution are the
lessons of a plan; `p2l.team.outcome.decide` gives every other task its best, which completes the way back.

Deviations from the thesis's proof:
1. The pre-trained skills are one more facility, open for free; without it an untaught, undelegated task could only be
   served at the big M.
2. A delegate facility serves one task only, so opening it or not is that task's own choice. It folds, together with the
   pre-trained facility, into one outside option per task: b_i = min(c_hum, c_rob + (1 - ρ_0) c_fail).
3. The facility of a lesson serves its own task at 0, since the demonstration completes it (equation 3.1).
4. With a free order (section 6.2.1) a lesson serves every task, not only the subsequent ones.
5. Service at the big M is no pair at all, nor is service that costs at least b_i: neither is ever worth paying.

The tests hold `of_problem` against the proof's instance, written out with all its 2n + 1 facilities.
"""

from __future__ import annotations

import math

import numpy as np

from p2l.records import Array, BoolArray
from p2l.team.facility.pairs import Pairs, collect
from p2l.team.problem import Problem


def of_problem(problem: Problem, deadline: float = math.inf) -> Pairs:
    """The facility location instance of Theorem 3.4.1: demand i is task i, facility j is the lesson on task j.

    Raises:
        TimeoutError: the `deadline` of `time.perf_counter` came first.
    """
    outside = problem.outside

    def block(low: int, high: int) -> tuple[Array, BoolArray]:
        cost = lesson_costs(problem, low, high)
        return cost, cost < outside[low:high, None]

    return collect(problem.c_demo.copy(), outside, block, deadline)


def lesson_costs(problem: Problem, low: int = 0, high: int | None = None) -> Array:
    """Service costs c_ij of the theorem: what a task (row) costs with the lesson on another one (column).

    Args:
        problem: n tasks.
        low: the first task.
        high: the task after the last one; n if none.

    Returns:
        [high - low, n] 0 for a task's own lesson, infinite where the lesson comes too late for the task.
    """
    high = problem.n if high is None else high
    cost = problem.attempt_cost(problem.transfer[:, low:high], slice(low, high)).T
    if problem.order == "fixed":
        cost[:, low:high][np.triu_indices(high - low, 1)] = np.inf
        cost[:, high:] = np.inf
    own = np.arange(high - low)
    cost[own, low + own] = 0.0
    return cost

"""The expected cost of given decisions, recomputed from the problem alone (thesis, equation 3.1).

This module is the naive reference of every planner: it knows nothing of facilities, pairs or solvers.

Deviation from the thesis: 1. At equal expected cost an untaught task goes to the person, whose result is certain, and
an attempt prefers the pre-trained skills, then the earliest lesson.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from p2l.errors import ShapeError
from p2l.records import Array, BoolArray, IntArray, freeze
from p2l.team.problem import Decision, Problem


@dataclass(frozen=True)
class Outcome:
    """What decisions lead to: skill [n] (as in `Plan`), p_success [n], expected_cost [n] and their total."""

    skill: IntArray
    p_success: Array
    expected_cost: Array

    @property
    def total(self) -> float:
        """Expected cost of the whole plan, rounded once."""
        return math.fsum(self.expected_cost.tolist())


def objective(problem: Problem, decision: IntArray, sequence: IntArray | None = None) -> Outcome:
    """Recompute what `decision` [n] costs when the tasks are done in the order of `sequence` [n].

    Without a sequence, `order="any"` puts the lessons first and `order="fixed"` keeps the work order.

    Raises:
        ShapeError: a decision that is none of act, delegate, learn; a sequence that is no permutation, or one that
            leaves the work order of a problem whose order is fixed.
    """
    decisions = freeze("decision", decision, ("n",), {"n": problem.n}, np.int64, low=0, high=2)
    is_taught = decisions == Decision.LEARN
    steps = work_order(problem, is_taught) if sequence is None else _permutation(problem, sequence)
    best, skill = best_skills(problem, is_taught, steps)
    cost = problem.attempt_cost(best)
    own = np.arange(problem.n)
    is_delegated = decisions == Decision.DELEGATE
    return Outcome(
        skill=np.where(is_taught, own, np.where(is_delegated, -1, skill)),
        p_success=np.where(is_taught | is_delegated, 1.0, best),
        expected_cost=np.where(is_taught, problem.c_demo, np.where(is_delegated, problem.c_hum, cost)),
    )


def decide(problem: Problem, is_taught: BoolArray, sequence: IntArray | None = None) -> IntArray:
    """[n] the best decision for every task once it is known which ones are taught."""
    steps = work_order(problem, is_taught) if sequence is None else sequence
    best, _ = best_skills(problem, is_taught, steps)
    act = problem.attempt_cost(best) < problem.c_hum
    return np.where(is_taught, Decision.LEARN, np.where(act, Decision.ACT, Decision.DELEGATE)).astype(np.int64)


def work_order(problem: Problem, is_taught: BoolArray) -> IntArray:
    """[n] the order of work: as given, or the lessons first where the order is free."""
    if problem.order == "fixed":
        return np.arange(problem.n)
    return np.argsort(~is_taught, kind="stable")


def best_skills(problem: Problem, is_taught: BoolArray, sequence: IntArray) -> tuple[Array, IntArray]:
    """[n] best success probability at the moment each task is due, and [n] the lesson it comes from (-1 for ρ_0)."""
    place = np.empty(problem.n, dtype=np.int64)
    place[sequence] = np.arange(problem.n)
    lessons = sequence[is_taught[sequence]]
    if not lessons.size:
        return problem.pretrained, np.full(problem.n, -1)
    usable = place[lessons][:, None] < place[None, :]
    probability = np.where(usable, problem.transfer[lessons], -1.0)
    pick = probability.argmax(axis=0)
    best = probability[pick, np.arange(problem.n)]
    better = best > problem.pretrained
    return np.where(better, best, problem.pretrained), np.where(better, lessons[pick], -1)


def _permutation(problem: Problem, sequence: IntArray) -> IntArray:
    steps: IntArray = freeze("sequence", sequence, ("n",), {"n": problem.n}, np.int64)
    natural = np.arange(problem.n)
    if not np.array_equal(np.sort(steps), natural):
        raise ShapeError("sequence: is not a permutation of the tasks; list every task index once")
    if problem.order == "fixed" and not np.array_equal(steps, natural):
        raise ShapeError("sequence: differs from the work order, but the problem's order is fixed")
    return steps

"""The exhaustive oracle: every set of lessons, every other task at its best. For tests and for very small problems."""

from __future__ import annotations

import math
import time

import numpy as np

from p2l.errors import SolverError
from p2l.records import BoolArray
from p2l.team.outcome import best_skills, work_order
from p2l.team.problem import Problem

LARGEST = 14


def exhaustive(problem: Problem, deadline: float = math.inf) -> BoolArray:
    """[n] the lessons of a cheapest plan, found by trying all 2^n sets (the smallest index set wins a tie).

    Raises:
        SolverError: more than 14 tasks.
        TimeoutError: the `deadline` of `time.perf_counter` came first.
    """
    if problem.n > LARGEST:
        raise SolverError(f"exhaustive: {problem.n} tasks given; it tries every set, so at most {LARGEST}. Use 'auto'")
    best_cost, best_lessons = float("inf"), np.zeros(problem.n, dtype=bool)
    for code in range(1 << problem.n):
        if time.perf_counter() > deadline:
            raise TimeoutError
        lessons = (code >> np.arange(problem.n)) & 1 == 1
        best_probability, _ = best_skills(problem, lessons, work_order(problem, lessons))
        attempt = problem.attempt_cost(best_probability)
        cost = math.fsum(np.where(lessons, problem.c_demo, np.minimum(problem.c_hum, attempt)).tolist())
        if cost < best_cost:
            best_cost, best_lessons = cost, lessons
    return best_lessons

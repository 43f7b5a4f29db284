"""An independent check of a plan and of its lower bound: no solver, no pairs, only the problem's own numbers.

L(v) = Σ_i v_i + Σ_j min(0, f_j - Σ_i (v_i - c_ij)⁺) with v_i <= b_i is a lower bound on every plan, whatever v is:
relaxing "every task is done once" with prices v leaves each lesson to be judged alone.
"""

from __future__ import annotations

import numpy as np

from p2l.records import Array
from p2l.team.problem import Problem

_BLOCK = 4_000_000


def lagrangian_bound(problem: Problem, multipliers: Array) -> float:
    """L(v) of a team problem, from scratch; multipliers [n] above b_i are cut to b_i."""
    v = np.minimum(multipliers, problem.outside)
    saved = np.zeros(problem.n)
    step = max(1, _BLOCK // problem.n)
    task = np.arange(problem.n)
    for low in range(0, problem.n, step):
        lessons = np.arange(low, min(problem.n, low + step))
        margin = np.maximum(v - problem.served(lessons), 0.0)
        if problem.order == "fixed":
            margin[task[None, :] < lessons[:, None]] = 0.0
        margin[lessons - low, lessons] = np.maximum(v[lessons], 0.0)
        saved[lessons] = margin.sum(axis=1)
    return float(v.sum() + np.minimum(0.0, problem.c_demo - saved).sum())

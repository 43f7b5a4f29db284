"""The planners that the thesis compares with: AD, CBA(θ) and ALM (section 3.5).

All three walk through the tasks in the given order and never look ahead; what CBA and ALM are taught joins the
library for the tasks that follow.

Deviations from the thesis: 1. CBA asks for a demonstration when its confidence equals θ ("greater than" attempts).
2. ALM attempts, and AD delegates, at equal expected cost. 3. They keep the given order even where it is free.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import cast

import numpy as np

from p2l.errors import ConfigError
from p2l.records import Array, IntArray
from p2l.team.outcome import objective
from p2l.team.problem import Decision, Problem


def act_delegate(problem: Problem) -> IntArray:
    """AD: [n] attempt or delegate, whichever is cheaper in expectation."""
    act = problem.attempt < problem.c_hum
    return np.where(act, Decision.ACT, Decision.DELEGATE).astype(np.int64)


def confidence_based(problem: Problem, theta: float) -> IntArray:
    """CBA(θ): [n] attempt where the confidence is above θ, ask for a demonstration elsewhere.

    Raises:
        ConfigError: θ outside [0, 1].
    """
    if isinstance(cast(object, theta), bool) or not isinstance(cast(object, theta), (int, float, np.number)):
        raise ConfigError(f"theta: {theta!r} given; CBA's threshold is a probability in [0, 1]")
    if not 0.0 <= theta <= 1.0:
        raise ConfigError(f"theta: {theta} given; CBA's threshold is a probability in [0, 1]")
    return _walk(problem, lambda _, confidence: confidence <= theta)


def act_learn_myopic(problem: Problem) -> IntArray:
    """ALM: [n] attempt or ask for a demonstration, whichever costs less at once."""

    def asks(task: int, confidence: float) -> bool:
        return bool(problem.c_demo[task] < problem.attempt_cost(np.array([confidence]), [task])[0])

    return _walk(problem, asks)


def best_theta(problems: Sequence[Problem], thetas: Sequence[float] | Array | None = None) -> tuple[float, Array]:
    """Grid search for CBA's threshold: the θ with the lowest mean cost, and [len(thetas)] the mean cost of each.

    Args:
        problems: the instances to average over.
        thetas: candidates; 0, 0.05 … 1 if none. The smallest one wins a tie.
    """
    grid = np.linspace(0.0, 1.0, 21) if thetas is None else np.asarray(thetas, dtype=np.float64)
    if not len(problems) or not grid.size:
        raise ConfigError("best_theta: needs at least one problem and one candidate θ")
    costs = [[_cost(problem, float(theta)) for problem in problems] for theta in grid]
    means = np.asarray(costs).mean(axis=1)
    return float(grid[means.argmin()]), means


def _cost(problem: Problem, theta: float) -> float:
    return objective(problem, confidence_based(problem, theta), np.arange(problem.n)).total


def _walk(problem: Problem, asks: Callable[[int, float], bool]) -> IntArray:
    confidence = problem.pretrained.copy()
    decision = np.full(problem.n, Decision.ACT, dtype=np.int64)
    for task in range(problem.n):
        if asks(task, float(confidence[task])):
            decision[task] = Decision.LEARN
            confidence = np.maximum(confidence, problem.transfer[task])
    return decision

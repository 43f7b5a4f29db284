"""Plans that need no search and are there at any deadline."""

from __future__ import annotations

import numpy as np

from p2l.records import BoolArray, IntArray
from p2l.team.outcome import decide, objective
from p2l.team.problem import Problem
from p2l.team.pruning import without_losses

_PRUNING = 1_000  # tasks up to which dropping lessons one by one takes no time worth mentioning
_TABLE = 200_000  # entries of the table that the quick choice looks at, in at most 0.1 s


def best_plan(problem: Problem, lessons: BoolArray | None = None, *, prune: bool = False) -> IntArray:
    """[n] the plan of these lessons, or a cheaper one that needs no search.

    Those are the plan without lessons, the one that teaches what pays for itself alone, the one that teaches all that
    can be taught, which does every task, and, where no solver has found any, a quick choice.

    Args:
        problem: the problem.
        lessons: [n] what is taught; None if no solver has found any.
        prune: drop lessons that do not pay first; of a quick choice they are dropped in any case.
    """
    none, teachable = np.zeros(problem.n, dtype=bool), np.isfinite(problem.c_demo)
    choices = [none, problem.c_demo < problem.outside, teachable]
    if problem.n > _PRUNING:  # each costs the time of a table of its lessons
        choices = [none] if np.isfinite(problem.outside).all() else [teachable]
    if lessons is None:
        lessons, prune = quick_lessons(problem), True
    if prune and problem.n <= _PRUNING:
        lessons = without_losses(problem, lessons)
    choices.insert(0, lessons)
    return min((decide(problem, each) for each in choices), key=lambda decision: objective(problem, decision).total)


def quick_lessons(problem: Problem) -> BoolArray:
    """[n] lessons added one by one, each the one that saves most, of some that are spread evenly over the tasks."""
    candidates = min(problem.n, max(1, _TABLE // problem.n))
    lessons = np.unique(np.linspace(0, problem.n - 1, candidates).round().astype(np.int64))
    lessons = lessons[np.isfinite(problem.c_demo[lessons])]
    chosen = np.zeros(problem.n, dtype=bool)
    if not lessons.size:
        return chosen
    tasks = np.arange(problem.n)
    cost = problem.service_cost(lessons)
    if problem.order == "fixed":
        cost[tasks[None, :] <= lessons[:, None]] = np.inf
    cost[np.arange(len(lessons)), lessons] = 0.0
    # A task without another way than a lesson counts as dear as teaching all of them, so that it gets one.
    dear = float(
        problem.c_demo[np.isfinite(problem.c_demo)].sum() + problem.outside[np.isfinite(problem.outside)].sum()
    )
    service = np.where(np.isfinite(problem.outside), problem.outside, dear)
    for _ in range(len(lessons)):
        saving = np.maximum(service[None, :] - cost, 0.0).sum(axis=1) - problem.c_demo[lessons]
        best = int(saving.argmax())
        if not saving[best] > 0.0:
            break
        chosen[lessons[best]] = True
        service = np.minimum(service, cost[best])
    return chosen

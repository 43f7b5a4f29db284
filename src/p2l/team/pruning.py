"""Lessons that do not pay for themselves, dropped from a plan that no solver has finished."""

from __future__ import annotations

import numpy as np

from p2l.records import Array, BoolArray, IntArray
from p2l.team.problem import Problem


def without_losses(problem: Problem, is_taught: BoolArray) -> BoolArray:
    """[n] the lessons that are left when those whose removal does not raise the cost are dropped, best saving first.

    A removal changes only the taught task itself and the tasks that its lesson serves; those fall back on their second
    best. So every saving is known at once, and after a removal only the rows that named the lesson are looked at again.
    """
    rest = is_taught.copy()
    lessons = np.flatnonzero(is_taught)
    count = len(lessons)
    table = _costs(problem, lessons)
    first, second = _two_best(table)
    tasks = np.arange(problem.n)
    alive = np.ones(count, dtype=bool)
    while alive.any():
        best = table[tasks, first]
        with np.errstate(invalid="ignore"):  # a task that only its own lesson does
            more = np.where(rest, 0.0, table[tasks, second] - best)
        lost = np.bincount(first, more, minlength=count + 2)[:count]
        saving = np.where(alive, problem.c_demo[lessons] - best[lessons] - lost, -np.inf)
        worst = int(saving.argmax())
        if saving[worst] < 0.0:
            break
        alive[worst] = rest[lessons[worst]] = False
        table[:, worst] = np.inf
        rows = np.flatnonzero((first == worst) | (second == worst))
        first[rows], second[rows] = _two_best(table[rows])
    return rest


def _costs(problem: Problem, lessons: IntArray) -> Array:
    """[n, L + 2] cost of each task (row) untaught: with each lesson, infinite where it cannot help, and twice without.

    The second copy of the outside option keeps the second best finite.
    """
    table = np.empty((problem.n, len(lessons) + 2))
    table[:, :-2] = problem.service_cost(lessons).T
    table[:, -2:] = problem.outside[:, None]
    tasks = np.arange(problem.n)[:, None]
    helps = lessons < tasks if problem.order == "fixed" else lessons != tasks
    table[:, :-2][~helps] = np.inf
    return table


def _two_best(table: Array) -> tuple[IntArray, IntArray]:
    """Columns of the smallest and the second smallest entry of each row."""
    rows = np.arange(len(table))
    first = table.argmin(axis=1)
    others = table.copy()
    others[rows, first] = np.inf
    return first, others.argmin(axis=1)

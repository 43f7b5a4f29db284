"""Every plan of a tiny shop, one by one: what all exact routes are held against in the tests."""

from __future__ import annotations

from itertools import combinations, permutations

import numpy as np

from p2l.errors import ShapeError, SolverError
from p2l.records import IntArray
from p2l.team.shop.outcome import shop_outcome
from p2l.team.shop.record import Shop

_LARGEST = 7  # groups, and facilities above which nothing is tried


def every_plan(shop: Shop) -> tuple[float, IntArray, IntArray]:
    """The cheapest cost, lessons [T, 2] and sequence [G] over all sets of lessons and all orders of work.

    Raises:
        SolverError: the shop is too large, or no plan of it is possible.
    """
    task, _ = shop.groups
    offers = [
        (lesson, robot)
        for lesson in range(len(shop.lessons))
        for robot in range(len(shop.robots))
        if np.isfinite(shop.c_demo[robot, lesson])
    ]
    if len(task) > _LARGEST or len(offers) > _LARGEST + 3:
        raise SolverError(f"exhaustive: {len(task)} groups and {len(offers)} lessons given; it tries every plan")
    given = np.lexsort((np.arange(len(task)), task))
    orders = [np.array(each) for each in permutations(range(len(task)))] if shop.order == "partial" else [given]
    best = (float("inf"), np.zeros((0, 2), dtype=np.int64), given)
    for size in range(len(offers) + 1):
        for taught in combinations(offers, size):
            lessons = np.array(taught, dtype=np.int64).reshape(-1, 2)
            if shop.order == "any":
                is_taught = np.isin(np.arange(len(task)), shop.completes[lessons[:, 0]])
                orders = [np.lexsort((np.arange(len(task)), task, ~is_taught))]
            for sequence in orders:
                try:
                    cost = shop_outcome(shop, lessons, sequence).total
                except ShapeError:
                    continue
                if cost < best[0]:
                    best = (cost, lessons, sequence)
    if not np.isfinite(best[0]):
        raise SolverError("exhaustive: no plan keeps the limits and decisions of this shop")
    return best

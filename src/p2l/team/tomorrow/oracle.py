"""Every plan for a tiny today and tomorrow, one by one: what the exact route is held against in the tests."""

from __future__ import annotations

from itertools import chain, combinations, permutations

import numpy as np

from p2l.errors import ShapeError, SolverError
from p2l.records import IntArray
from p2l.team.shop.outcome import shop_outcome
from p2l.team.tomorrow.record import TwoStage

_LARGEST = 6  # lessons to robots above which nothing is tried


def every_two_stage_plan(program: TwoStage) -> tuple[float, IntArray]:
    """The cheapest expected cost over all sets of lessons today and, for each, in every scenario; and lessons [T, 2].

    Raises:
        SolverError: too many lessons, or no plan is possible.
    """
    shop = program.today
    offers = [(each, r) for each in range(len(shop.lessons)) for r in range(len(shop.robots))]
    if len(offers) > _LARGEST:
        raise SolverError(f"exhaustive: {len(offers)} lessons to robots given; it tries every set of them")
    best, lessons = float("inf"), np.zeros((0, 2), dtype=np.int64)
    for taught in _subsets([each for each in offers if np.isfinite(shop.c_demo[each[1], each[0]])]):
        given = np.array(taught, dtype=np.int64).reshape(-1, 2)
        cost = _today(program, given)
        if not np.isfinite(cost):
            continue
        for scenario, p in enumerate(program.probability.tolist()):
            waiting = [tuple(each) for each in program.teachable().tolist()]
            cost += p * min(_tomorrow(program, scenario, taught, later) for later in _subsets(waiting))
        if cost < best:
            best, lessons = cost, given
    if not np.isfinite(best):
        raise SolverError("exhaustive: no plan does everything, and keeps today's limits and decisions")
    return best, lessons


def _subsets(offers: list[tuple[int, int]]) -> chain[tuple[tuple[int, int], ...]]:
    return chain.from_iterable(combinations(offers, size) for size in range(len(offers) + 1))


def _today(program: TwoStage, taught: IntArray) -> float:
    """What today costs with given lessons, in the best order of work."""
    shop = program.today
    task, _ = shop.groups
    by_task = np.arange(len(task))
    is_taught = np.isin(by_task, shop.completes[taught[:, 0]])
    orders = {
        "fixed": lambda: [np.lexsort((by_task, task))],
        "any": lambda: [np.lexsort((by_task, task, ~is_taught))],
        "partial": lambda: [np.array(each) for each in permutations(range(len(task)))],
    }
    costs = []
    for sequence in orders[shop.order]():
        try:
            costs.append(shop_outcome(shop, taught, sequence).total)
        except ShapeError:
            continue
    return min(costs, default=float("inf"))


def _tomorrow(
    program: TwoStage, scenario: int, taught: tuple[tuple[int, int], ...], later: tuple[tuple[int, int], ...]
) -> float:
    """What a scenario costs with given lessons of today and of tomorrow."""
    cost = sum(float(program.c_demo[robot, lesson]) for lesson, robot in later)
    for j, copies in enumerate(program.counts[scenario].tolist()):
        skills = [(r, float(program.pretrained[r, j])) for r in range(len(program.today.robots))]
        skills += [(robot, float(program.transfer[robot, lesson, j])) for lesson, robot in (*taught, *later)]
        ways = [float(program.c_hum[j])]
        for robot, skill in skills:
            risk, c_fail = 1.0 - skill, float(program.c_fail[robot, j])
            ways.append(float(program.c_rob[robot, j]) + (risk * c_fail if risk > 0.0 else 0.0))
        own = int(program.lesson[j])
        is_taught = own >= 0 and any(lesson == own for lesson, _ in later)
        left = max(0.0, copies - 1.0) if is_taught else copies
        cost += left * min(ways) if left > 0.0 else 0.0
    return cost

"""A shop as facility location (thesis, theorem 3.4.1): demands are groups of copies, facilities lessons of robots.

The proof's instance, with these changes, none of which is an approximation:

1. The facility of a lesson and a robot serves the first copy of the lesson's own task at 0, and costs `c_demo`.
2. A group of m copies is one demand whose services cost m times an attempt.
3. What a person has decided is in the costs: a task that is to be taught has no other service, one that is not to be
   taught no facility.
4. Pairs that the order forbids are left out; see `precedence` for what is left of a partial order.
"""

from __future__ import annotations

import math
import time
from typing import NamedTuple

import numpy as np

from p2l.records import Array, BoolArray, IntArray
from p2l.team.facility import Pairs, collect
from p2l.team.shop.outcome import attempt_cost
from p2l.team.shop.record import Ruling, Shop, precedence

_ROWS = 500_000  # entries of the dense table that are made between two looks at the clock


class Reduction(NamedTuple):
    """A shop's facility location instance.

    Attributes:
        pairs: of demands (groups of copies) and facilities.
        lesson: [F] of each facility; the facilities of a lesson follow each other, one for every robot.
        robot: [F] of each facility.
        weights: [2, F] what a facility takes of `max_lessons` and `max_teaching`.
    """

    pairs: Pairs
    lesson: IntArray
    robot: IntArray
    weights: Array


def reduce_shop(shop: Shop, dropped: BoolArray | None = None, *, deadline: float = math.inf) -> Reduction:
    """The instance of a shop.

    Args:
        shop: the day.
        dropped: [L, G] pairs of a lesson and a group that are left out, for every robot.
        deadline: of `time.perf_counter`.

    Raises:
        TimeoutError: the deadline came first.
    """
    lesson, robot = np.divmod(np.arange(len(shop.lessons) * len(shop.robots)), len(shop.robots))
    opening = np.where(may_be_taught(shop)[lesson], shop.c_demo[robot, lesson], np.inf)
    outside = outside_costs(shop)
    late = too_late(shop)

    def rows(low: int, high: int) -> tuple[Array, BoolArray]:
        if time.perf_counter() > deadline:
            raise TimeoutError
        cost = service_costs(shop, lesson, robot, np.arange(low, high), late)
        if dropped is not None:
            cost[dropped[lesson, low:high].T] = np.inf
        cost[:, np.isinf(opening)] = np.inf
        return cost, cost < outside[low:high, None]

    def block(low: int, high: int) -> tuple[Array, BoolArray]:
        step = max(1, _ROWS // max(1, len(lesson)))
        parts = [rows(each, min(high, each + step)) for each in range(low, high, step)]
        return np.concatenate([cost for cost, _ in parts]), np.concatenate([useful for _, useful in parts])

    pairs = collect(opening.copy(), outside, block, deadline)
    return Reduction(pairs, lesson, robot, np.stack([np.ones(len(lesson)), _finite(opening)]))


def service_costs(shop: Shop, lesson: IntArray, robot: IntArray, group: IntArray, late: BoolArray) -> Array:
    """[D, F] cost of groups (rows) by lessons to robots (columns), infinite where that cannot be.

    Args:
        shop: the day.
        lesson: [F] of each column.
        robot: [F] of each column.
        group: [D] of each row.
        late: [n, n] as of `too_late`.
    """
    task, size = shop.groups
    i, own = task[group], shop.completes[lesson]
    skill = shop.transfer[robot[None, :], lesson[None, :], i[:, None]]
    cost = attempt_cost(shop, robot[None, :], i[:, None], skill) * size[group].astype(np.float64)[:, None]
    cost[late[:, i][own].T & (own >= 0)[None, :]] = np.inf
    cost[shop.choice[i] == Ruling.DELEGATE] = np.inf
    is_first = group < shop.n
    cost[is_first & (shop.choice[i] == Ruling.LEARN)] = np.inf
    cost[is_first[:, None] & (own[None, :] == i[:, None])] = 0.0
    return cost


def _finite(costs: Array) -> Array:
    """Costs, 0 where they are infinite: what cannot be opened takes nothing of a limit."""
    return np.where(np.isinf(costs), 0.0, costs)


def outside_costs(shop: Shop) -> Array:
    """[G] cost of each group without any lesson."""
    task, size = shop.groups
    robots, tasks = np.arange(len(shop.robots))[:, None], np.arange(shop.n)[None, :]
    attempt = attempt_cost(shop, robots, tasks, shop.pretrained).min(axis=0)
    attempt = np.where(shop.choice == Ruling.DELEGATE, np.inf, attempt)
    person = np.where(shop.choice == Ruling.ACT, np.inf, shop.c_hum)
    is_taught = (np.arange(len(task)) < shop.n) & (shop.choice[task] == Ruling.LEARN)
    cost: Array = np.where(is_taught, np.inf, np.minimum(attempt, person)[task] * size)
    return cost


def too_late(shop: Shop) -> BoolArray:
    """[n, n] whether a lesson on a task (row) can never come before another task (column) is due."""
    if shop.order == "any":
        return np.zeros((shop.n, shop.n), dtype=bool)
    return precedence(shop).T.copy()


def may_be_taught(shop: Shop) -> BoolArray:
    """[L] lessons that no decision rules out."""
    is_open = (shop.choice == Ruling.FREE) | (shop.choice == Ruling.LEARN)
    allowed: BoolArray = (shop.completes < 0) | is_open[shop.completes]
    return allowed

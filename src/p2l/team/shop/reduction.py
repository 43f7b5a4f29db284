"""A shop as facility location (thesis, theorem 3.4.1): demands are groups of copies, facilities lessons of robots.

The proof's instance, with these changes, none of which is an approximation:

1. The facility of a lesson and a robot serves the first copy of the lesson's own task at 0, and costs `c_demo`.
2. A group of m copies is one demand whose services cost m times an attempt.
3. What a person has decided is in the costs: a task that is to be taught has no other service, one that is not to be
   taught no facility.
4. Pairs that the order forbids are left out; see `precedence` for what is left of a partial order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from p2l.records import Array, BoolArray, IntArray
from p2l.team.facility import Pairs, collect
from p2l.team.shop.outcome import attempt_cost
from p2l.team.shop.record import Ruling, Shop, precedence


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


def reduce_shop(shop: Shop, dropped: BoolArray | None = None) -> Reduction:
    """The instance of a shop.

    Args:
        shop: the day.
        dropped: [L, G] pairs of a lesson and a group that are left out, for every robot.
    """
    lesson, robot = np.divmod(np.arange(len(shop.lessons) * len(shop.robots)), len(shop.robots))
    opening = np.where(_not_taught(shop)[lesson], np.inf, shop.c_demo[robot, lesson])
    task, size = shop.groups
    outside = outside_costs(shop)
    late = too_late(shop)
    own = shop.completes[lesson]

    def block(low: int, high: int) -> tuple[Array, BoolArray]:
        i, m = task[low:high], size[low:high].astype(np.float64)
        skill = shop.transfer[robot[None, :], lesson[None, :], i[:, None]]
        cost = attempt_cost(shop, robot[None, :], i[:, None], skill) * m[:, None]
        cost[late[:, i][own].T & (own >= 0)[None, :]] = np.inf
        cost[shop.choice[i] == Ruling.DELEGATE] = np.inf
        is_first = np.arange(low, high) < shop.n
        cost[is_first & (shop.choice[i] == Ruling.LEARN)] = np.inf
        if dropped is not None:
            cost[dropped[lesson, low:high].T] = np.inf
        cost[is_first[:, None] & (own[None, :] == i[:, None])] = 0.0
        cost[:, np.isinf(opening)] = np.inf
        return cost, cost < outside[low:high, None]

    pairs = collect(opening.copy(), outside, block)
    return Reduction(pairs, lesson, robot, np.stack([np.ones(len(lesson)), _finite(opening)]))


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


def _not_taught(shop: Shop) -> BoolArray:
    """[L] lessons whose task is not to be taught."""
    closed = (shop.choice != Ruling.FREE) & (shop.choice != Ruling.LEARN)
    return (shop.completes >= 0) & closed[shop.completes]

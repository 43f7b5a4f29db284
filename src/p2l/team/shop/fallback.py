"""Plans of a shop that need no search, and a bound that needs no solver: for where the time is up before either."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from p2l.records import Array, BoolArray, IntArray
from p2l.team.costs import LARGEST
from p2l.team.shop.outcome import attempt_cost
from p2l.team.shop.record import Ruling, Shop
from p2l.team.shop.reduction import may_be_taught, outside_costs, service_costs, too_late

_TABLE = 200_000  # entries of the table that the quick choice looks at, in at most 0.1 s


def quick_choices(shop: Shop) -> Iterator[IntArray]:
    """Sets of lessons [T, 2], each to the robot that is cheapest to teach; the caller finds out which of them will do.

    What has to be taught and nothing else; with that, lessons added one by one, each the one that saves most, of some
    that are spread evenly; and, which takes longest and is the last resort, all that can be taught. The second keeps
    the limits if the first does.
    """
    robot = shop.c_demo.argmin(axis=0)
    price = shop.c_demo[robot, np.arange(len(shop.lessons))]
    own = shop.completes
    needed = (own >= 0) & (shop.choice[own] == Ruling.LEARN)
    possible = may_be_taught(shop) & np.isfinite(price) & ~needed
    yield _pairs(needed, robot)
    yield _pairs(_added(shop, robot, price, needed, possible), robot)
    yield _pairs(needed | possible, robot)


def _pairs(lessons: BoolArray, robot: IntArray) -> IntArray:
    taught = np.flatnonzero(lessons)
    return np.stack([taught, robot[taught]], axis=1)


def _added(shop: Shop, robot: IntArray, price: Array, needed: BoolArray, possible: BoolArray) -> BoolArray:
    """[L] lessons with which the plan of those that are needed saves."""
    chosen, outside = needed.copy(), outside_costs(shop)
    groups, free = np.arange(len(outside)), np.flatnonzero(possible)
    most = max(1, _TABLE // len(groups))
    candidates = np.concatenate([np.flatnonzero(needed), free[:: max(1, -(-len(free) // most))]])
    if not candidates.size:
        return chosen
    cost = service_costs(shop, candidates, robot[candidates], groups, too_late(shop)).T
    # A task without another way than a lesson counts as dear as all of them, so that it gets one.
    dear = float(price[possible | needed].sum() + outside[np.isfinite(outside)].sum())
    service = np.minimum(np.where(np.isfinite(outside), outside, dear), cost[: needed.sum()].min(axis=0, initial=dear))
    taken, count = math.fsum(price[needed].tolist()), int(needed.sum())
    prices, left = price[candidates], ~needed[candidates]
    while count < shop.max_lessons:
        saving = np.maximum(service[None, :] - cost, 0.0).sum(axis=1) - prices
        saving[~left | (taken + prices > shop.max_teaching)] = -np.inf
        best = int(saving.argmax())
        if not saving[best] > 0.0:
            break
        chosen[candidates[best]], left[best] = True, False
        taken, count, service = taken + float(prices[best]), count + 1, np.minimum(service, cost[best])
    return chosen


def cheapest_conceivable(shop: Shop) -> Array:
    """[G] multipliers that need no solver: every group at its cheapest if every lesson were given already, for free.

    No lesson can beat any of them, and no first copy is worth more than the lesson that would complete it. So the bound
    that they prove is their sum, without a look at the table of all services.
    """
    task, size = shop.groups
    robots, tasks = np.arange(len(shop.robots))[:, None], np.arange(shop.n)[None, :]
    best = np.maximum(shop.pretrained, shop.transfer.max(axis=1, initial=0.0))
    attempt = attempt_cost(shop, robots, tasks, best).min(axis=0)
    attempt = np.where(shop.choice == Ruling.DELEGATE, np.inf, attempt)
    person = np.where(shop.choice == Ruling.ACT, np.inf, shop.c_hum)
    cost = np.minimum(attempt, person)[task] * size
    cost[: shop.n][shop.choice == Ruling.LEARN] = np.inf
    lesson = np.full(len(task), np.inf)
    taught = np.flatnonzero(may_be_taught(shop) & (shop.completes >= 0))
    lesson[shop.completes[taught]] = shop.c_demo[:, taught].min(axis=0)
    cheapest: Array = np.minimum(np.minimum(cost, lesson), LARGEST)
    return cheapest

"""Covering search: plans of a given number of facilities where opening one costs more than all services can differ.

There the plan with the fewest facilities is the cheapest, so that what is searched is a set cover, and of those the one
with the cheapest services. Moves that add or drop a facility say little meanwhile, as each costs or saves an opening.
This search swaps. It closes the open facility that is missed least, takes one of the demands that nobody serves, and
opens the facility of its row that saves most. A demand counts more with every move that it stays without service, until
a plan serves it; when such prices have grown large they are halved, and services matter again.

Deviations from the source:
1. Service costs: what a move saves is price and service, not price alone.
2. Prices are halved, since grown without end they drown the services.
3. One facility fewer is tried in every third turn, not as soon as a cover is found.

Source: Gao, Weise and Li, "An efficient local search heuristic with row weighting for the unicost set covering problem"
(2015).
"""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np

from p2l.team.facility.alarm import Flag
from p2l.team.facility.kernel import kernel
from p2l.team.facility.local_search import Columns, open_cost
from p2l.team.facility.pairs import Pairs
from p2l.team.facility.tabu import Savings, Trail, _book, _flip, _random, _serve

_LARGE = 10.0  # rises of a demand's price, on average, from which all are halved


def is_covering(pairs: Pairs) -> bool:
    """Whether one opening, or one demand outside, costs more than all services together can differ."""
    some = np.flatnonzero(np.diff(pairs.start))
    if not some.size:
        return False
    dearest, cheapest = pairs.cost[pairs.start[some + 1] - 1], pairs.cost[pairs.start[some]]
    least = min(float(pairs.opening.min()), float((pairs.outside[some] - dearest).min()))
    return bool(float((dearest - cheapest).sum()) < least)


def cover(
    pairs: Pairs, columns: Columns, trail: Trail, count: int, effort: float, rng: np.random.Generator, flag: Flag
) -> Trail:
    """Search for a cheaper plan of `count` facilities from where a trail stands; its best plan is never given up.

    Args:
        pairs: the instance.
        columns: `columns_of(pairs)`.
        trail: of the search so far.
        count: facilities of the plans to look at.
        effort: steps of work, about a nanosecond or two each.
        rng: of the demands to serve next.
        flag: no further move when it is raised.
    """
    last = trail.last.copy()
    seed = rng.integers(1, 1 << 62, 1).astype(np.uint64)
    some = np.flatnonzero(np.diff(pairs.start))
    rise = float(pairs.cost.std()) if len(pairs.cost) else 0.0
    rise = rise if rise > 0.0 else 1.0
    price = pairs.outside.copy()
    price[some] = pairs.cost[pairs.start[some + 1] - 1] + rise
    priced = pairs._replace(outside=price)
    upper = trail.cost * (1.0 - 1e-12)
    best = _cover(
        priced, columns, pairs.outside, last, min(count, pairs.facilities), upper, rise, int(effort), seed, flag
    )
    cost = float(open_cost(pairs, best))
    return Trail(best, cost, last) if cost < trail.cost else trail._replace(last=last)


@kernel
def _missed_least(pairs, is_open, savings, since):
    """The open facility that is missed least, the oldest of equals; -1: none."""
    best, most = -1, -np.inf
    for j in range(is_open.size):
        if is_open[j]:
            saving = pairs.opening[j] - savings.loss[j]
            if saving > most or (saving == most and since[j] < since[best]):
                best, most = j, saving
    return best


@kernel
def _waiting(pairs, savings, seed):
    """One of the demands without service, at random; -1: all have it, or could have none."""
    chosen, count = -1, 0
    for i in range(savings.first.size):
        if savings.first[i] < 0 and pairs.start[i] < pairs.start[i + 1]:
            count += 1
            if _random(seed, count) == 0:
                chosen = i
    return chosen


@kernel
def _best_of_row(pairs, is_open, savings, since, move, i):
    """The closed facility that saves most, of demand i's row or (-1) of all, but none that this move closed."""
    best, most = -1, -np.inf
    first, end = (pairs.start[i], pairs.start[i + 1]) if i >= 0 else (0, is_open.size)
    for z in range(first, end):
        j = pairs.facility[z] if i >= 0 else z
        if is_open[j] or since[j] == move:
            continue
        saving = savings.relief[j] - pairs.opening[j]
        if saving > most or (saving == most and since[j] < since[best]):
            best, most = j, saving
    return best


@kernel
def _dearer(pairs, savings, rise):
    """Raise the price of every demand without service; returns by how much together."""
    total = 0.0
    for i in range(savings.first.size):
        if savings.first[i] < 0:
            _book(pairs, savings, i, -1.0)
            pairs.outside[i] += rise
            savings.near[i] = pairs.outside[i]
            _book(pairs, savings, i, 1.0)
            total += rise
    return total


@kernel
def _halve(pairs, is_open, savings, base):
    """Halve what prices have risen by; returns what is left of it."""
    total = 0.0
    for i in range(base.size):
        _book(pairs, savings, i, -1.0)
        pairs.outside[i] = base[i] + 0.5 * (pairs.outside[i] - base[i])
        _serve(pairs, is_open, savings, i)
        _book(pairs, savings, i, 1.0)
        total += pairs.outside[i] - base[i]
    return total


@kernel
def _cost(pairs, outside, is_open, savings):
    total = 0.0
    for j in range(is_open.size):
        if is_open[j]:
            total += pairs.opening[j]
    for i in range(outside.size):
        total += savings.near[i] if savings.first[i] >= 0 else outside[i]
    return total


@kernel
def _cover(pairs, columns, outside, is_open, count, upper, rise, effort, seed, flag):
    """[F] the best open set met, below `upper`, else the start; `is_open` becomes the last one.

    `pairs.outside` are the prices of demands without service, `outside` what they cost.
    """
    demands, facilities = outside.size, is_open.size
    first, near, far = np.full(demands, -1), np.empty(demands), np.empty(demands)
    savings = Savings(first, near, far, np.zeros(facilities), np.zeros(facilities), np.zeros(1, dtype=np.int64))
    for i in range(demands):
        _serve(pairs, is_open, savings, i)
        _book(pairs, savings, i, 1.0)
    base, risen = pairs.outside.copy(), 0.0
    best, since, now = is_open.copy(), np.zeros(facilities, dtype=np.int64), is_open.sum()
    move = 0
    while savings.steps[0] < effort and flag[0] == 0:
        move += 1
        savings.steps[0] += 2 * (facilities + demands)
        while now > 0 and now >= count:
            j = _missed_least(pairs, is_open, savings, since)
            _flip(pairs, columns, is_open, savings, j)
            since[j], now = move, now - 1
        while now < count:
            j = _best_of_row(pairs, is_open, savings, since, move, _waiting(pairs, savings, seed))
            if j < 0:
                break
            _flip(pairs, columns, is_open, savings, j)
            since[j], now = move, now + 1
        cost = _cost(pairs, outside, is_open, savings)
        if cost < upper:
            upper = cost
            best[:] = is_open
        risen += _dearer(pairs, savings, rise)
        if risen > _LARGE * rise * demands:
            risen = _halve(pairs, is_open, savings, base)
    return best

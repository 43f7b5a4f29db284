"""Tabu search: plans beyond the local optimum that add, drop and swap end in.

A move opens or closes one facility. Every facility's saving is kept up to date, so that the best move is found in one
pass over the facilities, and only demands that a move concerns are served again. Where the duality gap is large, plans
a few moves apart cost about the same and no descent tells them apart; this search walks through thousands of them.

Two rules take turns. "Steepest" makes the best move that is not tabu, for a random number of moves. "Random closing"
closes any open facility where no move improves the plan, and lengthens the time that moves stay tabu meanwhile.

Deviations from the source:
1. There are two rules: the steepest is better where many facilities are open, random closing where few are.
2. Effort is counted in steps of the kernel, not in moves or seconds, so that a search ends in the same plan everywhere.

Source: Michel and Van Hentenryck, "A simple tabu search for warehouse location" (2004).
"""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from p2l.records import Array, BoolArray, IntArray
from p2l.team.facility.alarm import Flag, silent
from p2l.team.facility.kernel import kernel
from p2l.team.facility.local_search import Columns, open_cost
from p2l.team.facility.pairs import Pairs

_SHORT, _SPREAD = 4, 6  # moves that stay tabu by the steepest rule: at least so many, and at random so many more
_LEAST, _MOST = 2, 10  # the range of the other rule


class Trail(NamedTuple):
    """Where a search stands: the best open set [F] and its cost, and the open set [F] that it goes on from."""

    best: BoolArray
    cost: float
    last: BoolArray


class Savings(NamedTuple):
    """Who serves each demand, and what opening or closing saves.

    Attributes:
        first: [D] facility that serves the demand; -1: outside.
        near: [D] its cost.
        far: [D] the next best cost; infinite where the demand is outside.
        loss: [F] extra service cost when an open facility is closed.
        relief: [F] service cost that opening a closed facility saves.
        steps: [1] of work so far.
    """

    first: IntArray
    near: Array
    far: Array
    loss: Array
    relief: Array
    steps: IntArray


def wander(
    pairs: Pairs,
    columns: Columns,
    trail: Trail,
    effort: float,
    rng: np.random.Generator,
    *,
    steepest: bool,
    flag: Flag | None = None,
) -> Trail:
    """Search on from where a trail stands; its best plan is never given up for a worse one.

    Args:
        pairs: the instance.
        columns: `columns_of(pairs)`.
        trail: of the search so far.
        effort: steps of work, about a nanosecond or two each.
        rng: of ties, of tenures and of facilities closed at random.
        steepest: the rule, see above.
        flag: no further move when it is raised.
    """
    last = trail.last.copy()
    seed = rng.integers(1, 1 << 62, 1).astype(np.uint64)
    threshold = 1e-12 * abs(trail.cost)
    flag = silent() if flag is None else flag
    best = _wander(pairs, columns, last, trail.cost, int(effort), seed, steepest, threshold, flag)
    cost = float(open_cost(pairs, best))
    return Trail(best, cost, last) if cost < trail.cost else trail._replace(last=last)


@kernel
def _random(seed, count):
    """A random whole number below `count`, by Marsaglia's xorshift."""
    x = seed[0]
    x ^= x << np.uint64(13)
    x ^= x >> np.uint64(7)
    x ^= x << np.uint64(17)
    seed[0] = x
    return np.int64((x >> np.uint64(11)) % np.uint64(count))


@kernel
def _book(pairs, savings, i, sign):
    """Add demand i's part of every saving, or with sign -1 take it off."""
    facility, cost, relief, near = pairs.facility, pairs.cost, savings.relief, savings.near[i]
    if savings.first[i] >= 0:
        savings.loss[savings.first[i]] += sign * (savings.far[i] - near)
    z, end = pairs.start[i], pairs.start[i + 1]
    while z < end and cost[z] < near:
        relief[facility[z]] += sign * (near - cost[z])
        z += 1
    savings.steps[0] += z - pairs.start[i] + 1


@kernel
def _serve(pairs, is_open, savings, i):
    """Find demand i's cheapest and second cheapest open service."""
    savings.first[i], savings.near[i], savings.far[i] = -1, pairs.outside[i], np.inf
    facility = pairs.facility
    for z in range(pairs.start[i], pairs.start[i + 1]):
        if is_open[facility[z]]:
            if savings.first[i] >= 0:
                savings.far[i] = pairs.cost[z]
                break
            savings.first[i], savings.near[i], savings.far[i] = facility[z], pairs.cost[z], pairs.outside[i]


@kernel
def _flip(pairs, columns, is_open, savings, j):
    """Open or close facility j and serve again every demand that this concerns."""
    is_open[j] = not is_open[j]
    for p in range(columns.start[j], columns.start[j + 1]):
        i = columns.demand[p]
        if columns.cost[p] <= savings.far[i]:
            _book(pairs, savings, i, -1.0)
            _serve(pairs, is_open, savings, i)
            _book(pairs, savings, i, 1.0)


@kernel
def _saving(pairs, is_open, savings, j):
    return pairs.opening[j] - savings.loss[j] if is_open[j] else savings.relief[j] - pairs.opening[j]


@kernel
def _best_move(pairs, is_open, savings, until, move, wanted, seed, threshold):
    """The facility (-1: none) that saves most, ties at random; a tabu one only where it saves more than is `wanted`."""
    best, most, ties = -1, -np.inf, 0
    opening, loss, relief = pairs.opening, savings.loss, savings.relief  # a tuple's fields cost more in the loop
    for j in range(is_open.size):
        saving = opening[j] - loss[j] if is_open[j] else relief[j] - opening[j]
        if until[j] > move and saving <= wanted + threshold:
            continue
        if saving > most + threshold:
            best, most, ties = j, saving, 1
        elif saving > most - threshold:
            ties += 1
            if _random(seed, ties) == 0:
                best = j
    return best


@kernel
def _any_open(is_open, count, seed):
    """One of `count` open facilities at random."""
    place = _random(seed, count)
    for j in range(is_open.size):
        if is_open[j]:
            if place == 0:
                return j
            place -= 1
    return -1


@kernel
def _wander(pairs, columns, is_open, upper, effort, seed, steepest, threshold, flag):
    """[F] the best open set met, below `upper`, else the start; `is_open` becomes the last one."""
    demands, facilities = pairs.outside.size, is_open.size
    first, near, far = np.full(demands, -1), np.empty(demands), np.empty(demands)
    savings = Savings(first, near, far, np.zeros(facilities), np.zeros(facilities), np.zeros(1, dtype=np.int64))
    cost, count = pairs.opening[is_open].sum(), is_open.sum()
    for i in range(demands):
        _serve(pairs, is_open, savings, i)
        _book(pairs, savings, i, 1.0)
        cost += savings.near[i]
    best = is_open.copy()
    until = np.zeros(facilities, dtype=np.int64)
    tenure, move = _LEAST, 0
    while savings.steps[0] < effort and flag[0] == 0:
        move += 1
        savings.steps[0] += facilities
        j = _best_move(pairs, is_open, savings, until, move, cost - upper, seed, threshold)
        if steepest:
            tenure = _SHORT + _random(seed, _SPREAD)
        elif j < 0 or _saving(pairs, is_open, savings, j) < -threshold:
            tenure = min(_MOST, tenure + 1)
            j = _any_open(is_open, count, seed) if count > 0 else j
        elif _saving(pairs, is_open, savings, j) > threshold:
            tenure = max(_LEAST, tenure - 1)
        if j < 0:
            continue
        cost -= _saving(pairs, is_open, savings, j)
        count += -1 if is_open[j] else 1
        _flip(pairs, columns, is_open, savings, j)
        until[j] = move + tenure + (1 if steepest else 0)
        if cost < upper - threshold:
            upper = cost
            best[:] = is_open
    return best

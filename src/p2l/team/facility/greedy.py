"""The greedy O(log n) algorithm of section 3.4: always the star that serves its new demands most cheaply.

A star is a facility and some unserved demands; its price is (opening + service) / demands, and opening is paid once.
Leaving a demand outside is a star of one. With n demands the cost is at most H_n = 1 + 1/2 + … + 1/n times the optimum,
since the prices paid, divided by H_n, are a feasible dual; raised by dual ascent they give the bound that is reported.

Source: Hochbaum, "Heuristics for the fixed cost median problem" (1982); thesis, section 3.4.
"""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import heapq

import numpy as np

from p2l.records import Array, BoolArray
from p2l.team.facility.alarm import Flag, silent
from p2l.team.facility.dual_ascent import dual_ascent
from p2l.team.facility.kernel import kernel
from p2l.team.facility.local_search import Columns, columns_of
from p2l.team.facility.pairs import Pairs


def guarantee(demands: int) -> float:
    """H_n, the factor within which `greedy_solution` stays of the optimum."""
    return float((1.0 / np.arange(1, demands + 1)).sum())


def greedy_solution(pairs: Pairs, flag: Flag | None = None) -> tuple[BoolArray, Array]:
    """The open set [F] of the greedy algorithm and multipliers [D] whose sum is a lower bound.

    Where the `flag` is raised, demands that are not served yet stay outside, at prices that prove nothing: each
    demand's cheapest cost is the dual instead.
    """
    flag = silent() if flag is None else flag
    columns = _by_cost(columns_of(pairs))
    opening = pairs.opening.copy()
    is_unserved = np.ones(pairs.demands, dtype=np.bool_)
    price = pairs.outside.copy()
    outside_first = np.argsort(pairs.outside, kind="stable")
    heap = []
    for j in range(pairs.facilities):
        if flag[0]:
            return opening < 0.0, dual_ascent(pairs, None, flag)[0]
        heap.append((_star(columns, opening[j], is_unserved, j)[0], j))
    heapq.heapify(heap)
    for i in outside_first:
        if flag[0]:
            return opening < 0.0, dual_ascent(pairs, None, flag)[0]
        _serve_cheaper_stars(heap, columns, opening, is_unserved, price, float(pairs.outside[i]))
        is_unserved[i] = False  # served by a star just now, or cheapest outside: its price is b_i already
    open_set = opening < 0.0
    multipliers, _ = dual_ascent(pairs, price / guarantee(pairs.demands), flag)
    return open_set, multipliers


def _serve_cheaper_stars(
    heap: list[tuple[float, int]], columns: Columns, opening: Array, is_unserved: BoolArray, price: Array, limit: float
) -> None:
    """Serve stars below the price `limit`, cheapest first. A key is a lower bound: prices only rise as demands go."""
    while heap and heap[0][0] < limit:
        _, j = heapq.heappop(heap)
        cost, size = _star(columns, max(0.0, opening[j]), is_unserved, j)
        if size == 0:
            continue
        if cost <= (heap[0][0] if heap else np.inf) and cost < limit:
            _serve(columns, is_unserved, price, j, size, cost)
            opening[j] = -1.0  # open: later stars of j pay service only
            cost, size = _star(columns, 0.0, is_unserved, j)
        if size:
            heapq.heappush(heap, (cost, j))


@kernel
def _star(columns, opening, is_unserved, j):
    """Price and size of facility j's cheapest star among the unserved demands; its column is sorted by cost."""
    total, size, best, best_size = opening, 0, np.inf, 0
    for p in range(columns.start[j], columns.start[j + 1]):
        if not is_unserved[columns.demand[p]]:
            continue
        if columns.cost[p] >= best:
            break
        total += columns.cost[p]
        size += 1
        if total / size < best:
            best, best_size = total / size, size
    return best, best_size


@kernel
def _serve(columns, is_unserved, price, j, size, cost):
    for p in range(columns.start[j], columns.start[j + 1]):
        i = columns.demand[p]
        if size > 0 and is_unserved[i]:
            is_unserved[i] = False
            price[i] = cost
            size -= 1


def _by_cost(columns: Columns) -> Columns:
    column = np.repeat(np.arange(len(columns.start) - 1), np.diff(columns.start))
    order = np.lexsort((columns.cost, column))
    return Columns(columns.start, columns.demand[order], columns.cost[order])

"""Add, drop and swap: a plan that no single move can improve.

Every demand remembers its cheapest and second cheapest open service (the outside option counts as open). Dropping a
facility is then priced by its own demands, inserting one by its own column, and the best partner of the newcomer falls
out of the same pass.

Source: Whitaker's fast interchange as analysed by Resende and Werneck, "A hybrid multistart heuristic for the
uncapacitated facility location problem" (2006).
"""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from p2l.records import Array, BoolArray, IntArray
from p2l.team.facility.alarm import Flag, silent
from p2l.team.facility.kernel import kernel
from p2l.team.facility.pairs import Pairs


class Columns(NamedTuple):
    """The pairs by facility: start [F + 1], demand [Z] int32, cost [Z]."""

    start: IntArray
    demand: npt.NDArray[np.int32]
    cost: Array


class Service(NamedTuple):
    """Who serves each demand: first [D] (-1: outside), near [D] its cost, far [D] the next best; loss [F] by dropping.

    `loss` is the extra service cost when an open facility is dropped.
    """

    first: IntArray
    near: Array
    far: Array
    loss: Array


def columns_of(pairs: Pairs) -> Columns:
    """Turn the rows of an instance into columns."""
    return Columns(*_transpose(pairs))


def descend(
    pairs: Pairs, columns: Columns, open_set: BoolArray, usable: BoolArray, flag: Flag | None = None
) -> BoolArray:
    """[F] the open set after improving moves, until none is left.

    Args:
        pairs: the instance.
        columns: `columns_of(pairs)`.
        open_set: [F] where to begin.
        usable: [F] facilities that may be inserted.
        flag: no further move when it is raised.
    """
    result = open_set.copy()
    threshold = 1e-12 * float(open_cost(pairs, result))
    _descend(pairs, columns, result, usable, silent() if flag is None else flag, threshold)
    return result


@kernel
def open_cost(pairs, is_open):
    """Cost of an open set [F], from scratch: opening, plus each demand at its cheapest open or outside service."""
    total = 0.0
    for j in range(is_open.size):
        if is_open[j]:
            total += pairs.opening[j]
    for i in range(pairs.outside.size):
        best = pairs.outside[i]
        for z in range(pairs.start[i], pairs.start[i + 1]):
            if is_open[pairs.facility[z]]:
                best = pairs.cost[z]
                break
        total += best
    return total


@kernel
def _transpose(pairs):
    facility = pairs.facility
    start = np.zeros(pairs.opening.size + 1, dtype=np.int64)
    for z in range(facility.size):
        start[facility[z] + 1] += 1
    start = np.cumsum(start)
    place = start[:-1].copy()
    demand, cost = np.empty(facility.size, dtype=np.int32), np.empty(facility.size)
    for i in range(pairs.outside.size):
        for z in range(pairs.start[i], pairs.start[i + 1]):
            p = place[facility[z]]
            demand[p], cost[p] = i, pairs.cost[z]
            place[facility[z]] += 1
    return start, demand, cost


@kernel
def _serve(pairs, is_open, service, i):
    """Find demand i's cheapest and second cheapest open service and book its share of the loss."""
    service.first[i], service.near[i], service.far[i] = -1, pairs.outside[i], np.inf
    for z in range(pairs.start[i], pairs.start[i + 1]):
        if is_open[pairs.facility[z]]:
            if service.first[i] >= 0:
                service.far[i] = pairs.cost[z]
                break
            service.first[i], service.near[i], service.far[i] = pairs.facility[z], pairs.cost[z], pairs.outside[i]
    if service.first[i] >= 0:
        service.loss[service.first[i]] += service.far[i] - service.near[i]


@kernel
def _reassign(pairs, columns, is_open, service, j):
    """Serve again every demand that a change of facility j can concern."""
    for p in range(columns.start[j], columns.start[j + 1]):
        i = columns.demand[p]
        if columns.cost[p] <= service.far[i]:
            if service.first[i] >= 0:
                service.loss[service.first[i]] -= service.far[i] - service.near[i]
            _serve(pairs, is_open, service, i)


@kernel
def relieve(pairs, columns, service, j, relief, rivals):
    """Saving of inserting closed facility j, and how many rivals lose something to it, with repetitions.

    `relief` [F], zero on entry, collects what the newcomer takes off each open facility's loss; `rivals` names them.
    """
    gain, count = -pairs.opening[j], 0
    for p in range(columns.start[j], columns.start[j + 1]):
        i, cost = columns.demand[p], columns.cost[p]
        if cost >= service.far[i]:
            continue
        k = service.first[i]
        gain += max(0.0, service.near[i] - cost)
        if k >= 0:
            rivals[count] = k
            count += 1
            relief[k] += service.far[i] - max(cost, service.near[i])
    return gain, count


@kernel
def _judge(pairs, columns, service, j, relief, rivals):
    """Saving of inserting closed facility j, and the partner (-1: none) whose drop goes best with it.

    `relief` is zero on entry and exit.
    """
    gain, count = relieve(pairs, columns, service, j, relief, rivals)
    saving, partner = gain, -1
    for c in range(count):
        k = rivals[c]
        if relief[k] > 0.0:
            swap = gain + pairs.opening[k] - service.loss[k] + relief[k]
            if swap > saving:
                saving, partner = swap, k
            relief[k] = 0.0
    return saving, partner


@kernel
def _descend(pairs, columns, is_open, usable, flag, threshold):
    demands, facilities = pairs.outside.size, is_open.size
    service = Service(np.empty(demands, np.int64), np.empty(demands), np.empty(demands), np.zeros(facilities))
    for i in range(demands):
        _serve(pairs, is_open, service, i)
    relief, rivals = np.zeros(facilities), np.empty(demands, dtype=np.int64)
    count, since, j = 0, 0, 0
    while since < facilities and flag[0] == 0:
        saving, partner = 0.0, -1
        if is_open[j]:
            saving = pairs.opening[j] - service.loss[j]
        elif usable[j]:
            saving, partner = _judge(pairs, columns, service, j, relief, rivals)
        since += 1
        if saving > threshold:
            is_open[j] = not is_open[j]
            _reassign(pairs, columns, is_open, service, j)
            if partner >= 0:
                is_open[partner] = False
                _reassign(pairs, columns, is_open, service, partner)
            count, since = count + 1, 0
        j = j + 1 if j + 1 < facilities else 0
    return count

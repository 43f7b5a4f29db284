"""Add, drop and swap where what is opened is limited: a plan within the limits that no single move can improve.

As `local_search`, with weights: a facility is added only where it fits, and swapped in only where the one that goes
makes room for it. A start that breaks a limit first loses what is missed least for its weight.
"""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np

from p2l.records import Array, BoolArray
from p2l.team.facility.alarm import Flag, silent
from p2l.team.facility.kernel import kernel
from p2l.team.facility.local_search import Columns, Service, _reassign, _serve, open_cost, relieve
from p2l.team.facility.pairs import Pairs


def descend_within(
    pairs: Pairs,
    columns: Columns,
    weights: Array,
    limits: Array,
    open_set: BoolArray,
    usable: BoolArray,
    flag: Flag | None = None,
) -> BoolArray:
    """[F] an open set within the limits after improving moves, until none is left.

    Args:
        pairs: the instance.
        columns: `columns_of(pairs)`.
        weights: [K, F] what each facility takes of each limit.
        limits: [K] what the open facilities may take together.
        open_set: [F] where to begin; may break the limits.
        usable: [F] facilities that may be inserted.
        flag: no further move when it is raised, but for those that keep the limits.
    """
    result = open_set.copy()
    threshold = 1e-12 * float(open_cost(pairs, result))
    _descend_within(pairs, columns, weights, limits, result, usable, silent() if flag is None else flag, threshold)
    return result


@kernel
def _fits(weights, limits, used, j, partner):
    for k in range(limits.size):
        more = weights[k, j] - (weights[k, partner] if partner >= 0 else 0.0)
        if more > 0.0 and used[k] + more > limits[k]:
            return False
    return True


@kernel
def _book(weights, used, j, sign):
    for k in range(used.size):
        used[k] += sign * weights[k, j]


@kernel
def _excess(weights, limits, used, j):
    """What facility j takes of the limits that are broken, as shares of them; 0 if none is."""
    total = 0.0
    for k in range(limits.size):
        if used[k] > limits[k]:
            total += weights[k, j] / max(limits[k], 1e-300)
    return total


@kernel
def _keep_limits(pairs, columns, weights, limits, is_open, used, service):
    while True:
        worst, least = -1, np.inf
        for j in range(is_open.size):
            if is_open[j]:
                excess = _excess(weights, limits, used, j)
                if excess > 0.0:
                    loss = (service.loss[j] - pairs.opening[j]) / excess
                    if loss < least or worst < 0:
                        worst, least = j, loss
        if worst < 0:
            return
        is_open[worst] = False
        _book(weights, used, worst, -1.0)
        _reassign(pairs, columns, is_open, service, worst)


@kernel
def _judge_within(pairs, columns, weights, limits, used, service, j, relief, rivals, is_open):
    """Saving of inserting closed facility j where it fits, and the partner (-1: none) whose drop goes best with it."""
    gain, count = relieve(pairs, columns, service, j, relief, rivals)
    saving, partner = 0.0, -1
    fits = _fits(weights, limits, used, j, -1)
    if fits:
        saving = gain
    for k in range(is_open.size):
        if is_open[k] and (relief[k] > 0.0 or not fits):
            swap = gain + pairs.opening[k] - service.loss[k] + relief[k]
            if swap > saving and _fits(weights, limits, used, j, k):
                saving, partner = swap, k
    for c in range(count):
        relief[rivals[c]] = 0.0
    return saving, partner, fits


@kernel
def _descend_within(pairs, columns, weights, limits, is_open, usable, flag, threshold):
    demands, facilities = pairs.outside.size, is_open.size
    service = Service(np.empty(demands, np.int64), np.empty(demands), np.empty(demands), np.zeros(facilities))
    for i in range(demands):
        _serve(pairs, is_open, service, i)
    used = np.zeros(limits.size)
    for j in range(facilities):
        if is_open[j]:
            _book(weights, used, j, 1.0)
    _keep_limits(pairs, columns, weights, limits, is_open, used, service)
    relief, rivals = np.zeros(facilities), np.empty(demands, dtype=np.int64)
    since, j = 0, 0
    while since < facilities and flag[0] == 0:
        saving, partner, fits = 0.0, -1, True
        if is_open[j]:
            saving = pairs.opening[j] - service.loss[j]
        elif usable[j]:
            saving, partner, fits = _judge_within(
                pairs, columns, weights, limits, used, service, j, relief, rivals, is_open
            )
        since += 1
        if saving > threshold and (fits or partner >= 0):
            _book(weights, used, j, -1.0 if is_open[j] else 1.0)
            is_open[j] = not is_open[j]
            _reassign(pairs, columns, is_open, service, j)
            if partner >= 0:
                is_open[partner] = False
                _book(weights, used, partner, -1.0)
                _reassign(pairs, columns, is_open, service, partner)
            since = 0
        j = j + 1 if j + 1 < facilities else 0

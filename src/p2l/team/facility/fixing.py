"""Reduced-cost fixing: what no plan better than the incumbent can contain is removed.

With a bound L(v) and a plan of cost U, a facility whose reduced cost exceeds U - L(v) is closed in every better plan,
one below -(U - L(v)) is open, and a pair is unused when opening its facility and overpaying its demand's price would
together exceed the gap. Demands are never removed, so multipliers keep their meaning on the smaller instance.
"""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from p2l.records import BoolArray, IntArray
from p2l.team.facility.kernel import kernel
from p2l.team.facility.pairs import Pairs
from p2l.team.facility.volume import CLOSED, FREE, OPEN, Bound, State


class Core(NamedTuple):
    """What is left to decide.

    Attributes:
        pairs: the smaller instance.
        origin: [F] index of each of its facilities in the instance it came from.
        state: [F] OPEN where every better plan opens the facility, FREE elsewhere.
    """

    pairs: Pairs
    origin: IntArray
    state: State


def whole(pairs: Pairs) -> Core:
    """The instance itself, with nothing decided."""
    return Core(pairs, np.arange(pairs.facilities), np.zeros(pairs.facilities, dtype=np.int8))


def fix(state: State, bound: Bound, gap: float) -> State:
    """[F] the state after fixing free facilities by their reduced costs; `gap` = U - L(v)."""
    after = state.copy()
    free = state == FREE
    after[free & (bound.reduced_cost > gap)] = CLOSED
    after[free & (bound.reduced_cost < -gap)] = OPEN
    return after


def shrink(core: Core, bound: Bound, gap: float, keep: BoolArray, most: float = 1.0) -> tuple[Core, Bound] | None:
    """The core without the facilities and pairs that fixing removes, and the bound in its indices.

    None where more than the share `most` of its pairs stay. Facilities marked in `keep` [F] (the incumbent) stay, with
    all their pairs.
    """
    pairs = core.pairs
    state = fix(core.state, bound, gap)
    stays = (state != CLOSED) | keep
    detour = np.where(state == OPEN, 0.0, np.maximum(bound.reduced_cost, 0.0))  # an open one is paid
    detour[keep], detour[~stays] = -np.inf, np.inf
    start = _count_useful(pairs, bound.multipliers, detour, gap, bool(keep.any()))
    if start[-1] > most * len(pairs.cost):
        return None
    rest = np.flatnonzero(stays)
    new_index = np.full(pairs.facilities, -1, dtype=np.int32)
    new_index[rest] = np.arange(rest.size)
    facility, cost = _gather_useful(pairs, bound.multipliers, detour, gap, start, new_index)
    smaller = Pairs(pairs.opening[rest], pairs.outside, start, facility, cost)
    smaller_bound = bound._replace(reduced_cost=bound.reduced_cost[rest], share=bound.share[rest])
    return Core(smaller, core.origin[rest], np.maximum(state[rest], np.int8(FREE))), smaller_bound


@kernel
def _count_useful(pairs, v, detour, gap, whole_rows):
    """[D + 1] where each row would begin; the end of a row is read only where pairs are kept however dear."""
    start, facility, cost = pairs.start, pairs.facility, pairs.cost
    new_start, count = np.zeros(start.size, dtype=np.int64), 0
    for i in range(v.size):
        for z in range(start[i], start[i + 1]):
            above = max(cost[z] - v[i], 0.0)
            if above > gap and not whole_rows:
                break
            if detour[facility[z]] + above <= gap:
                count += 1
        new_start[i + 1] = count
    return new_start


@kernel
def _gather_useful(pairs, v, detour, gap, new_start, new_index):
    facility, cost = np.empty(new_start[-1], dtype=np.int32), np.empty(new_start[-1])
    for i in range(v.size):
        place, z = new_start[i], pairs.start[i]
        while place < new_start[i + 1]:
            j = pairs.facility[z]
            if detour[j] + max(pairs.cost[z] - v[i], 0.0) <= gap:
                facility[place], cost[place] = new_index[j], pairs.cost[z]
                place += 1
            z += 1
    return facility, cost

"""Reduced-cost fixing: what no plan better than the incumbent can contain is removed.

With a bound L(v) and a plan of cost U, a facility whose reduced cost exceeds U - L(v) is closed in every better plan,
one below -(U - L(v)) is open, and a pair is unused when opening its facility and overpaying its demand's price would
together exceed the gap. Demands are never removed, so multipliers keep their meaning on the smaller instance.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from p2l.records import BoolArray, IntArray
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


def shrink(core: Core, bound: Bound, gap: float, keep: BoolArray) -> tuple[Core, Bound]:
    """The core without the facilities and pairs that fixing removes, and the bound in its indices.

    Facilities marked in `keep` [F] (the incumbent) stay, with all their pairs.
    """
    pairs = core.pairs
    state = fix(core.state, bound, gap)
    stays = (state != CLOSED) | keep
    detour = np.where(state == OPEN, 0.0, np.maximum(bound.reduced_cost, 0.0))[pairs.facility]  # an open one is paid
    detour += np.maximum(pairs.cost - np.repeat(bound.multipliers, np.diff(pairs.start)), 0.0)
    useful = ((detour <= gap) | keep[pairs.facility]) & stays[pairs.facility]
    rest = np.flatnonzero(stays)
    new_index = np.full(pairs.facilities, -1, dtype=np.int32)
    new_index[rest] = np.arange(rest.size)
    smaller = Pairs(
        opening=pairs.opening[rest],
        outside=pairs.outside,
        start=np.concatenate([[0], np.cumsum(useful)])[pairs.start],
        facility=new_index[pairs.facility[useful]],
        cost=pairs.cost[useful],
    )
    smaller_bound = bound._replace(reduced_cost=bound.reduced_cost[rest], share=bound.share[rest])
    return Core(smaller, core.origin[rest], np.maximum(state[rest], np.int8(FREE))), smaller_bound

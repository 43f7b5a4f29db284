"""Cases of how many facilities are open, where that alone closes most of the gap.

Where opening costs are much alike and service costs little, a plan costs about its number of facilities times the
opening cost. The linear relaxation opens a fraction more than 11 of them where every plan needs 15, and branching on
single facilities has to raise that fraction everywhere. Two cases say more. "At least 15" is priced at once: a bonus μ
on every opening, paid back 15 times, takes the relaxation almost up to the plan. In "at most 14" a fine M on every
opening leaves nothing to prove but that fewer do not suffice.

A demand that is left outside counts as one that is open, as it is one (`p2l.team.facility.pairs.of_table`). Both cases
are facility location instances again, with other opening costs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from p2l.records import Array, BoolArray
from p2l.team.facility.alarm import Alarm
from p2l.team.facility.dual_ascent import dual_ascent
from p2l.team.facility.fixing import Core
from p2l.team.facility.pairs import Pairs
from p2l.team.facility.tree import Tree
from p2l.team.facility.volume import Bound, bound_of, raise_bound

_WORTH = 0.01  # relative gap from which the cases are tried
_FIRST, _ENOUGH = 0.3, 0.6  # share of the gap that the first trial of μ must close, and the best one
_FINE = 10.0  # M, in mean opening costs
_RESERVE = 2.2  # times what the best μ leaves of an opening cost: in nodes below, the best one is lower
_TRIALS = 10  # of μ
_ITERATIONS = 300  # of the volume algorithm per trial
_GOLDEN = 0.618034


class CountCase(NamedTuple):
    """A part of the search, in prices of its own.

    Attributes:
        core: what is left to decide; every opening and outside cost is lower by `price` than the true one.
        bound: of it, in the same prices.
        price: what a facility that is open, or a demand outside, counts less.
        offset: to be added to a bound in these prices.
        node: of the tree.
    """

    core: Core
    bound: Bound
    price: float
    offset: float
    node: int

    def true_bound(self, core: Core, multipliers: Array) -> tuple[Array, float]:
        """Multipliers [D] for the true costs, made of those of a node, and the bound that they give there.

        A fine is so large that a bound in its prices says little about costs before it says everything.
        """
        lowest = float(core.pairs.opening.min()) if core.pairs.facilities else 0.0
        share = (lowest + self.price) / lowest if self.price < 0.0 < lowest else 1.0
        pairs = priced(core.pairs, -self.price)
        v = np.minimum(multipliers * share, pairs.outside)
        return v, bound_of(pairs, core.state, v)


def priced(pairs: Pairs, price: float) -> Pairs:
    """The instance in which every opening, and every demand outside, costs `price` less."""
    return pairs._replace(opening=pairs.opening - price, outside=pairs.outside - price)


def whole_search(core: Core, bound: Bound, node: int) -> CountCase:
    """The one part of a search that is not divided."""
    return CountCase(core, bound, 0.0, 0.0, node)


def count_cases(
    whole: CountCase, open_set: BoolArray, upper: float, cutoff: float, tree: Tree, alarm: Alarm
) -> list[CountCase]:
    """The two cases that divide a search at the number of facilities of its plan, or the search itself.

    Args:
        whole: the search.
        open_set: [F] the plan.
        upper: its cost.
        cutoff: what bounds are to reach.
        tree: the proof so far.
        alarm: ends it.
    """
    pairs, gap = whole.core.pairs, cutoff - whole.bound.value
    count = _count(pairs, open_set)
    most = min(float(pairs.opening.min()), float(pairs.outside.min())) if len(pairs.cost) else 0.0
    if gap <= _WORTH * upper or count - float(whole.bound.share.sum()) < 0.5 or most <= 0.0:
        return [whole]
    if _tried(whole.core, 0.75 * most, count, cutoff, 100, alarm)[1] < cutoff - (1.0 - _FIRST) * gap:
        return [whole]
    price, value = _best_price(whole.core, most, count, cutoff, alarm)
    price -= (_RESERVE - 1.0) * (most - price)
    bound = _tried(whole.core, price, count, cutoff, _ITERATIONS, alarm)[0]
    if value < cutoff - (1.0 - _ENOUGH) * gap or alarm.rang:
        return [whole]
    fine = -_FINE * float(pairs.opening.mean())
    few_core = whole.core._replace(pairs=priced(pairs, fine))
    few_bound = raise_bound(
        few_core.pairs,
        few_core.state,
        dual_ascent(few_core.pairs, None, alarm.flag)[0],
        cutoff - (count - 1) * fine,
        _ITERATIONS,
        flag=alarm.flag,
    )
    few = CountCase(
        few_core, few_bound, fine, (count - 1) * fine, tree.count_case(whole.node, count - 1, is_more=False)
    )
    many_core = whole.core._replace(pairs=priced(pairs, price))
    many = CountCase(many_core, bound, price, count * price, tree.count_case(whole.node, count - 1, is_more=True))
    tree.price(few.node, few_bound.multipliers, fine)
    tree.price(many.node, bound.multipliers, price)
    return [few, many]


def _count(pairs: Pairs, open_set: BoolArray) -> int:
    """How many facilities are open, and demands outside."""
    served = np.zeros(pairs.demands, dtype=bool)
    served[pairs.rows()[open_set[pairs.facility]]] = True
    return int(open_set.sum()) + int((~served).sum())


def _tried(core: Core, price: float, count: int, cutoff: float, iterations: int, alarm: Alarm) -> tuple[Bound, float]:
    """The bound of at least `count` at a price, in its prices and in true ones."""
    pairs = priced(core.pairs, price)
    start, _ = dual_ascent(pairs, None, alarm.flag)
    bound = raise_bound(pairs, core.state, start, cutoff - count * price, iterations, flag=alarm.flag)
    return bound, bound.value + count * price


def _best_price(core: Core, most: float, count: int, cutoff: float, alarm: Alarm) -> tuple[float, float]:
    """The price below `most` with the highest bound, and that; golden section over the logarithm of its rest."""
    low, high = 0.0, 8.0  # most · e^-low … most · e^-high is left
    known: dict[float, tuple[float, float]] = {}

    def at(place: float) -> float:
        if place not in known:
            price = most * (1.0 - float(np.exp(-place)))
            value = _tried(core, price, count, cutoff, _ITERATIONS, alarm)[1]
            known[place] = price, value
        return known[place][1]

    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    for _ in range(_TRIALS):
        if at(left) >= at(right):
            high, right = right, left
            left = high - _GOLDEN * (high - low)
        else:
            low, left = left, right
            right = low + _GOLDEN * (high - low)
    return max(known.values(), key=lambda each: each[1])

"""What a question is worth by every plan and every answer, one by one: what `values` is held against in the tests.

It asks no solver. Each set of lessons is tried, with what everything costs that the person does not do; at some costs
of the person each group is then done by whoever is cheaper.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from p2l.errors import ShapeError, SolverError
from p2l.records import Array, BoolArray
from p2l.team.preferences.belief import possible_answers, priced
from p2l.team.preferences.record import Preferences
from p2l.team.problem import Decision
from p2l.team.shop import Ruling, Shop, shop_outcome

_LARGEST = 10  # lessons above which nothing is tried


@dataclass(frozen=True)
class EveryPlan:
    """All sets of lessons of a shop, in a fixed or in any order of work.

    Attributes:
        shop: the day.
        alone: [S, G] cost of each group where the person does none of it; infinite where that is not possible.
        by_lesson: [S, G] whether the group's demonstration completes it, so that nothing is left for the person.
        apart: [S] cost of lessons that complete none of today's tasks.
    """

    shop: Shop
    alone: Array
    by_lesson: BoolArray
    apart: Array

    @classmethod
    def of(cls, shop: Shop) -> EveryPlan:
        """Every set that keeps the shop's limits and decisions.

        Raises:
            SolverError: too many lessons, a partial order, or no set at all.
        """
        offers = np.argwhere(np.isfinite(shop.c_demo.T)).tolist()
        if len(offers) > _LARGEST or shop.order == "partial":
            raise SolverError(f"exhaustive: {len(offers)} lessons, {shop.order} order; at most {_LARGEST}, not partial")
        task, _ = shop.groups
        nobody = replace(shop, c_hum=np.full(shop.n, np.inf))
        outcomes = []
        for size in range(len(offers) + 1):
            for taught in combinations(offers, size):
                lessons = np.array(taught, dtype=np.int64).reshape(-1, 2)
                last = ~np.isin(np.arange(len(task)), shop.completes[lessons[:, 0]]) & (shop.order == "any")
                try:
                    outcomes.append(shop_outcome(nobody, lessons, np.lexsort((np.arange(len(task)), task, last))))
                except ShapeError:  # a limit, or a decision that is made
                    continue
        if not outcomes:
            raise SolverError("exhaustive: no plan keeps the limits and decisions of this shop")
        return cls(
            shop=shop,
            alone=np.array([each.expected_cost for each in outcomes]),
            by_lesson=np.array([each.decision == Decision.LEARN for each in outcomes]),
            apart=np.array([each.lessons_apart for each in outcomes]),
        )

    def least(self, preferences: Preferences, cost: Array) -> float:
        """Cost of the best plan at costs [F] of the families."""
        task, size = self.shop.groups
        person = priced(self.shop, preferences, cost).c_hum[task] * size
        person = np.where(self.shop.choice[task] == Ruling.ACT, np.inf, person)
        cheaper = np.where(self.by_lesson, self.alone, np.minimum(self.alone, person))
        return float((cheaper.sum(axis=1) + self.apart).min())


def every_answer(
    shop: Shop, preferences: Preferences, c_ask: float, look_ahead: int = 1, plans: EveryPlan | None = None
) -> Array:
    """[F] value of each question and of what may follow it, its own price not taken off.

    Raises:
        SolverError: as `EveryPlan.of`, or nobody can do some task.
    """
    plans = EveryPlan.of(shop) if plans is None else plans
    now = plans.least(preferences, preferences.mean)
    if not np.isfinite(now):
        raise SolverError("exhaustive: nobody can do some task of this shop")
    values = []
    for family in range(len(preferences.families)):
        chance, after = possible_answers(preferences, family)
        value = now
        for share, then in zip(chance.tolist(), after, strict=True):
            value -= share * plans.least(preferences, then.mean)
            if look_ahead > 1:
                value += share * max(0.0, *(every_answer(shop, then, c_ask, look_ahead - 1, plans) - c_ask))
        values.append(value)
    return np.array(values)

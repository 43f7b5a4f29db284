"""Plan a shop: exact, with a certificate (thesis, theorem 3.4.1 and section 6.2.1)."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from p2l.errors import ConfigError, ShapeError, SolverError
from p2l.records import Array, BoolArray, IntArray
from p2l.team.certificate import PROVEN
from p2l.team.contract import check_stopping
from p2l.team.problem import Status, relative_gap
from p2l.team.shop.certificate import shop_bound
from p2l.team.shop.circle import sequence_of
from p2l.team.shop.fallback import cheapest_conceivable, quick_choices
from p2l.team.shop.faults import fault_of
from p2l.team.shop.outcome import ShopOutcome, shop_outcome
from p2l.team.shop.record import Shop, ShopCertificate, ShopPlan
from p2l.team.shop.reduction import Reduction, reduce_shop
from p2l.team.shop.search import OrderSearch

_FINISH = 0.15  # share of the time limit that is left for the check


def plan_shop(shop: Shop, *, time_limit_s: float = 60.0, gap: float = 0.0) -> ShopPlan:
    """Decide for every group of copies who does it, and which lessons are given to which robot.

    Args:
        shop: the day.
        time_limit_s: wall seconds; at the limit the best plan so far is returned with its true bound.
        gap: relative gap at which the search may stop; 0 proves optimality.

    Raises:
        ConfigError: a time limit of zero or less, a gap outside [0, 1); no plan keeps the limits and decisions.
        SolverError: no plan was found in time.

    Example:
        Three tasks alike, of which at most one lesson may be given:

        >>> import numpy as np
        >>> from p2l import Problem, Shop, plan_shop
        >>> from dataclasses import replace
        >>> cost = {name: np.full(3, value) for name, value in (("c_rob", 10.0), ("c_hum", 100.0), ("c_fail", 100.0))}
        >>> problem = Problem(("a", "b", "c"), **cost, c_demo=np.full(3, 120.0), pretrained=np.zeros(3),
        ...                   transfer=np.full((3, 3), 0.9))
        >>> day = plan_shop(replace(Shop.of_problem(problem), max_lessons=1))
        >>> day.status, round(day.objective, 1), len(day.taught)
        ('optimal', 160.0, 1)
    """
    limit_s, gap = check_stopping(time_limit_s, gap)
    start = time.perf_counter()
    search = _ShopSearch(shop, start + limit_s * (1.0 - _FINISH), gap)
    complete = search.run()
    best = search.best
    if best is None:
        if complete:
            fault = fault_of(shop, lambda other: _has_plan(other, start + limit_s))
            raise ConfigError(f"no plan keeps the limits and the decisions that are made: {fault}; loosen one of them")
        raise SolverError("no plan was found in time; give more time, or loosen a limit")
    proof, proven = search.proven()
    bound = min(best.outcome.total, proven)
    relative = relative_gap(best.outcome.total, bound)
    status: Status = "optimal" if relative <= PROVEN else "feasible" if complete else "time_limit"
    outcome = best.outcome
    return ShopPlan(
        planner="auto", status=status, taught=best.taught, sequence=best.sequence, decision=outcome.decision,
        robot=outcome.robot, lesson=outcome.lesson, p_success=outcome.p_success, expected_cost=outcome.expected_cost,
        objective=outcome.total, lower_bound=bound, gap=relative, seconds=time.perf_counter() - start,
        certificate=proof,
    )  # fmt: skip


def _has_plan(shop: Shop, deadline: float) -> bool:
    """Whether a shop has a plan, as far as can be known by the deadline."""
    search = _ShopSearch(shop, deadline, 0.5)
    return search.best is not None if search.run() else True


@dataclass(frozen=True)
class _Found:
    """A plan: lessons [T, 2], sequence [G] and what it comes to."""

    taught: IntArray
    sequence: IntArray
    outcome: ShopOutcome

    @property
    def total(self) -> float:
        return self.outcome.total


class _ShopSearch(OrderSearch[_Found]):
    def reduce(self, dropped: BoolArray | None, deadline: float) -> Reduction:
        return reduce_shop(self.shop, dropped, deadline=deadline)

    def bound(self, proof: ShopCertificate) -> float:
        return shop_bound(self.shop, proof)

    def quick(self) -> Iterator[_Found]:
        for number, taught in enumerate(quick_choices(self.shop)):
            if number == 2 and self.best is not None:
                return  # the last resort takes longest
            with suppress(ShapeError):  # more than the limits allow
                yield self._plan(taught, sequence_of(self.shop, taught))

    def conceivable(self) -> Array:
        return cheapest_conceivable(self.shop)

    def found(self, reduction: Reduction, open_set: BoolArray, taught: IntArray, sequence: IntArray) -> _Found:  # noqa: ARG002
        return self._plan(taught, sequence)

    def _plan(self, taught: IntArray, sequence: IntArray) -> _Found:
        outcome = shop_outcome(self.shop, taught, sequence)
        used = np.zeros(len(taught), dtype=bool)
        for place, (lesson, robot) in enumerate(taught.tolist()):
            used[place] = bool(((outcome.lesson == lesson) & (outcome.robot == robot)).any())
        if not used.all():
            taught = taught[used]
            outcome = shop_outcome(self.shop, taught, sequence)
        return _Found(taught, sequence, outcome)

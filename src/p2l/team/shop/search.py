"""The search for a plan under an order of work: facility location, in cases where lessons wait for each other.

A day without a partial order is one facility location instance, within limits if there are any. Under a partial order
the pairs that it rules out are left out first. What remains can still choose lessons in a circle: task b by the lesson
on a, which has to wait for c, and c's successor by the lesson on b. Then cases follow, in each of which one pair of the
circle is left out; some pair of it has to be, so no plan is lost.
"""

from __future__ import annotations

import heapq
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Generic, Protocol, TypeVar

import numpy as np

from p2l.records import Array, BoolArray, IntArray
from p2l.team import facility
from p2l.team.certificate import PROVEN
from p2l.team.costs import LARGEST
from p2l.team.facility import PairsSolution
from p2l.team.loading import loaded
from p2l.team.problem import Certificate
from p2l.team.shop.circle import circle_of, sequence_of
from p2l.team.shop.record import Shop, ShopCertificate
from p2l.team.shop.reduction import Reduction

_SMALL = 40  # demands up to which HiGHS is asked for the relaxation first, as for the thesis's problems
_TINY = 20  # demands up to which HiGHS also branches: 2 to 8 ms, where compiled kernels take 7 to 23, and 450 to load
_MAKING = 0.4  # share of the time that making the instance may take, since checking takes as long
_CHECKING = 1.5  # times as long, to be safe


class Found(Protocol):
    """A plan that a search has found."""

    @property
    def total(self) -> float:
        """Its expected cost."""


FoundPlan = TypeVar("FoundPlan", bound=Found)


@dataclass
class _OrderCase:
    """A case of the search: the pairs left out, and what is known of it."""

    parent: int
    pair: tuple[int, int]
    dropped: BoolArray
    leaf: Certificate | None = None
    open_set: BoolArray | None = None
    complete: bool = True
    circle: list[tuple[int, int]] = field(default_factory=list)


class OrderSearch(ABC, Generic[FoundPlan]):
    """A search that remembers its cases and the best plan so far.

    Args:
        shop: the day whose order of work is kept.
        deadline: of `time.perf_counter`.
        gap: relative gap that is good enough.
    """

    best: FoundPlan | None

    def __init__(self, shop: Shop, deadline: float, gap: float) -> None:
        self.shop, self.deadline, self.gap = shop, deadline, gap
        self.best = None
        self.check_s = 0.0  # what the check of one case takes
        nothing = np.zeros((len(shop.lessons), len(shop.groups[0])), dtype=bool)
        self.cases = [_OrderCase(-1, (-1, -1), nothing)]

    @abstractmethod
    def reduce(self, dropped: BoolArray | None, deadline: float) -> Reduction:
        """The instance without some pairs [L, G] of lessons and today's groups; the day's demands come first in it.

        Raises:
            TimeoutError: the deadline came first.
        """

    @abstractmethod
    def found(self, reduction: Reduction, open_set: BoolArray, taught: IntArray, sequence: IntArray) -> FoundPlan:
        """The plan that an open set [F] stands for: lessons [T, 2] of today in a sequence [G]."""

    @abstractmethod
    def bound(self, proof: ShopCertificate) -> float:
        """What no plan costs less than."""

    def quick(self) -> Iterator[FoundPlan]:
        """Plans that need no search, for where the time is up before one; each is offered before the next is made."""
        return iter(())

    def conceivable(self) -> Array | None:
        """[D] multipliers whose sum is a bound that needs no check, if there are any."""
        return None

    def run(self) -> bool:
        """Look at cases, the one with the lowest bound first; whether it ended before the deadline."""
        try:
            low, whole = self._look(0)
        except TimeoutError:
            self._offer_quickly()
            return False
        waiting = [(low, 0)]
        while waiting:
            low, number = heapq.heappop(waiting)
            case = self.cases[number]
            if not case.circle or low >= self._cutoff():
                continue
            if not number:
                self.check_s = self._check_s()
            if time.perf_counter() + self.check_s * len(self.cases) > self.deadline:
                return False
            first = len(self.cases)
            for pair in case.circle:
                dropped = case.dropped.copy()
                dropped[pair] = True
                self.cases.append(_OrderCase(number, pair, dropped))
                below, ended = self._look(len(self.cases) - 1)
                if not ended:  # what is half done proves less than the case that it is part of
                    del self.cases[first:]
                    return False
                heapq.heappush(waiting, (max(low, below), len(self.cases) - 1))
        return whole

    def _check_s(self) -> float:
        start = time.perf_counter()
        self.bound(self.proof())
        return time.perf_counter() - start

    def proven(self) -> tuple[ShopCertificate, float]:
        """The proof, and its bound: the one of the search, or, where that was cut short, one that needs no check."""
        proof, bound = self.proof(), -math.inf
        if (root := self.cases[0]).leaf is not None:
            bound = self.bound(proof)
        if len(self.cases) > 1 or (root.leaf is not None and root.complete):
            return proof, bound
        if (multipliers := self.conceivable()) is None:
            return proof, bound
        low = math.fsum(multipliers.tolist()) * (1.0 - PROVEN / 1000)
        if low <= bound:
            return proof, bound
        return replace(proof, leaf=(Certificate.of(multipliers),)), low

    def proof(self) -> ShopCertificate:
        """All cases, and the certificates of those without cases below them."""
        parents = {case.parent for case in self.cases}
        return ShopCertificate(
            parent=np.array([case.parent for case in self.cases]),
            lesson=np.array([case.pair[0] for case in self.cases]),
            group=np.array([case.pair[1] for case in self.cases]),
            leaf=tuple(None if number in parents else case.leaf for number, case in enumerate(self.cases)),
        )

    def _cutoff(self) -> float:
        if self.best is None:
            return math.inf
        return self.best.total * (1.0 - max(self.gap, 0.5 * PROVEN))

    def _look(self, number: int) -> tuple[float, bool]:
        """Solve a case; its bound, and whether that is within the gap of what it costs."""
        case = self.cases[number]
        if number:
            try:
                reduction = self.reduce(case.dropped, self.deadline)
            except TimeoutError:
                return -math.inf, False
        else:
            start = time.perf_counter()
            reduction = self.reduce(None, start + _MAKING * (self.deadline - start))
            self.deadline -= _CHECKING * (time.perf_counter() - start)
        impossible = np.isinf(reduction.pairs.outside) & (np.diff(reduction.pairs.start) == 0)
        if impossible.any():
            case.leaf = Certificate.of(np.where(impossible, LARGEST, 0.0))  # nothing serves it at any price
            return math.inf, True
        solution = self._solve(reduction, self.cases[max(0, case.parent)])
        if not (number or solution.complete):
            self._offer_quickly()
        case.leaf, case.open_set, case.complete = solution.certificate, solution.open, solution.complete
        if not math.isfinite(solution.cost):
            return math.inf, solution.complete
        today = _of_day(self.shop, reduction)
        open_today = solution.open[: len(today.lesson)]
        facilities = np.flatnonzero(open_today)
        taught = np.stack([today.lesson[facilities], today.robot[facilities]], axis=1)
        case.circle, sequence = circle_of(self.shop, today, open_today)
        order = sequence if not case.circle else sequence_of(self.shop, taught)
        self._offer(self.found(reduction, solution.open, taught, order))
        return solution.cost * (1.0 - PROVEN) if solution.complete else -math.inf, solution.complete

    def _offer_quickly(self) -> None:
        for plan in self.quick():
            self._offer(plan)

    def _offer(self, plan: FoundPlan) -> None:
        if math.isfinite(plan.total) and (self.best is None or plan.total < self.best.total):
            self.best = plan

    def _solve(self, reduction: Reduction, parent: _OrderCase) -> PairsSolution:
        pairs = reduction.pairs
        few = pairs.demands * pairs.facilities if pairs.demands <= _SMALL else -1
        limits = np.array([self.shop.max_lessons, self.shop.max_teaching])
        used = np.isfinite(limits)
        known = None if parent.leaf is None else np.minimum(parent.leaf.multipliers[parent.leaf.row[0]], pairs.outside)
        if not used.any() or self._is_within(reduction, limits, self._quick(reduction)):
            free = facility.solve_small_or_large(
                pairs, self.deadline, self.gap, few=few, tiny=_TINY, multipliers=known, open_set=parent.open_set
            )
            if self._is_within(reduction, limits, free.open):
                return free
        try:
            solve_within = loaded(facility.within_limits, self.deadline).solve_within
        except TimeoutError:
            return _without_lessons(pairs)
        within: PairsSolution = solve_within(
            pairs, reduction.weights[used], limits[used], deadline=self.deadline, gap=self.gap
        )
        return within

    def _is_within(self, reduction: Reduction, limits: Array, open_set: BoolArray) -> bool:
        return bool((reduction.weights[:, open_set].sum(axis=1) <= limits).all())

    def _quick(self, reduction: Reduction) -> BoolArray:
        """[F] what a heuristic opens without limits: whether it keeps them tells which search comes first."""
        try:
            solve = loaded(facility.large_scale, self.deadline)
        except TimeoutError:
            return np.zeros(reduction.pairs.facilities, dtype=bool)
        open_set: BoolArray = solve.dual_ascent_lessons(reduction.pairs, self.deadline)[0]
        return open_set


def _of_day(shop: Shop, reduction: Reduction) -> Reduction:
    """The part of an instance that is the day's own: its groups come first, and so do its lessons."""
    groups, width = len(shop.groups[0]), len(shop.lessons) * len(shop.robots)
    pairs = reduction.pairs
    if pairs.demands == groups:
        return reduction
    end = int(pairs.start[groups])
    own = facility.Pairs(
        opening=pairs.opening[:width],
        outside=pairs.outside[:groups],
        start=pairs.start[: groups + 1],
        facility=pairs.facility[:end],
        cost=pairs.cost[:end],
    )
    return Reduction(own, reduction.lesson[:width], reduction.robot[:width], reduction.weights[:, :width])


def _without_lessons(pairs: facility.Pairs) -> PairsSolution:
    """What is known where there is no time to search: the plan without lessons, and every group at its cheapest."""
    none = np.zeros(pairs.facilities, dtype=bool)
    has_pair = np.diff(pairs.start) > 0
    first = np.minimum(pairs.start[:-1], max(0, len(pairs.cost) - 1))
    cheapest = np.where(has_pair, pairs.cost[first], pairs.outside) if len(pairs.cost) else pairs.outside
    return PairsSolution(none, float(pairs.outside.sum()), False, Certificate.of(cheapest))

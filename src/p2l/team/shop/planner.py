"""Plan a shop: exact, with a certificate (thesis, theorem 3.4.1 and section 6.2.1).

A shop without a partial order is one facility location instance, within limits if there are any. Under a partial order
the pairs that it rules out are left out first. What remains can still choose lessons in a circle: task b by the lesson
on a, which has to wait for c, and c's successor by the lesson on b. Then cases follow, in each of which one pair of the
circle is left out; some pair of it has to be, so no plan is lost.
"""

from __future__ import annotations

import heapq
import math
import time
from dataclasses import dataclass, field

import numpy as np

from p2l.errors import ConfigError, SolverError
from p2l.records import Array, BoolArray, IntArray
from p2l.team import facility
from p2l.team.certificate import PROVEN
from p2l.team.contract import check_stopping
from p2l.team.costs import LARGEST
from p2l.team.facility import PairsSolution
from p2l.team.loading import loaded
from p2l.team.problem import Certificate, Status, relative_gap
from p2l.team.shop.certificate import shop_bound
from p2l.team.shop.circle import circle_of, sequence_of
from p2l.team.shop.outcome import ShopOutcome, shop_outcome
from p2l.team.shop.record import Shop, ShopCertificate, ShopPlan
from p2l.team.shop.reduction import Reduction, reduce_shop

_SMALL = 40  # groups up to which HiGHS is asked for the relaxation first, as for the thesis's problems
_TINY = 20  # groups up to which HiGHS also branches: 2 to 8 ms, where compiled kernels take 7 to 23, and 450 to load
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
            raise ConfigError("no plan keeps the limits and the decisions that are made; loosen one of them")
        raise SolverError("no plan was found in time; give more time, or loosen a limit")
    proof = search.proof()
    bound = min(best.outcome.total, shop_bound(shop, proof))
    relative = relative_gap(best.outcome.total, bound)
    status: Status = "optimal" if relative <= PROVEN else "feasible" if complete else "time_limit"
    outcome = best.outcome
    return ShopPlan(
        planner="auto", status=status, taught=best.taught, sequence=best.sequence, decision=outcome.decision,
        robot=outcome.robot, lesson=outcome.lesson, p_success=outcome.p_success, expected_cost=outcome.expected_cost,
        objective=outcome.total, lower_bound=bound, gap=relative, seconds=time.perf_counter() - start,
        certificate=proof,
    )  # fmt: skip


@dataclass(frozen=True)
class _Found:
    """A plan: lessons [T, 2], sequence [G] and what it comes to."""

    taught: IntArray
    sequence: IntArray
    outcome: ShopOutcome


@dataclass
class _OrderCase:
    """A case of the search: the pairs left out, and what is known of it."""

    parent: int
    pair: tuple[int, int]
    dropped: BoolArray
    leaf: Certificate | None = None
    open_set: BoolArray | None = None
    circle: list[tuple[int, int]] = field(default_factory=list)


class _ShopSearch:
    def __init__(self, shop: Shop, deadline: float, gap: float) -> None:
        self.shop, self.deadline, self.gap = shop, deadline, gap
        self.best: _Found | None = None
        self.check_s = 0.0  # what the check of one case takes
        nothing = np.zeros((len(shop.lessons), len(shop.groups[0])), dtype=bool)
        self.cases = [_OrderCase(-1, (-1, -1), nothing)]

    def run(self) -> bool:
        """Look at cases, the one with the lowest bound first; whether it ended before the deadline."""
        low, whole = self._look(0)
        start = time.perf_counter()
        shop_bound(self.shop, self.proof())
        self.check_s = time.perf_counter() - start
        waiting = [(low, 0)]
        while waiting:
            low, number = heapq.heappop(waiting)
            case = self.cases[number]
            if not case.circle or low >= self._cutoff():
                continue
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
        return self.best.outcome.total * (1.0 - max(self.gap, 0.5 * PROVEN))

    def _look(self, number: int) -> tuple[float, bool]:
        """Solve a case; its bound, and whether that is within the gap of what it costs."""
        case = self.cases[number]
        reduction = reduce_shop(self.shop, case.dropped if number else None)
        impossible = np.isinf(reduction.pairs.outside) & (np.diff(reduction.pairs.start) == 0)
        if impossible.any():
            case.leaf = Certificate.of(np.where(impossible, LARGEST, 0.0))  # nothing serves it at any price
            return math.inf, True
        solution = self._solve(reduction, self.cases[max(0, case.parent)])
        case.leaf, case.open_set = solution.certificate, solution.open
        if not math.isfinite(solution.cost):
            return math.inf, solution.complete
        facilities = np.flatnonzero(solution.open)
        taught = np.stack([reduction.lesson[facilities], reduction.robot[facilities]], axis=1)
        case.circle, sequence = circle_of(self.shop, reduction, solution.open)
        self._offer(taught, sequence if not case.circle else sequence_of(self.shop, taught))
        return solution.cost * (1.0 - PROVEN) if solution.complete else -math.inf, solution.complete

    def _offer(self, taught: IntArray, sequence: IntArray) -> None:
        outcome = shop_outcome(self.shop, taught, sequence)
        used = np.zeros(len(taught), dtype=bool)
        for place, (lesson, robot) in enumerate(taught.tolist()):
            used[place] = bool(((outcome.lesson == lesson) & (outcome.robot == robot)).any())
        if not used.all():
            taught = taught[used]
            outcome = shop_outcome(self.shop, taught, sequence)
        if math.isfinite(outcome.total) and (self.best is None or outcome.total < self.best.outcome.total):
            self.best = _Found(taught, sequence, outcome)

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


def _without_lessons(pairs: facility.Pairs) -> PairsSolution:
    """What is known where there is no time to search: the plan without lessons, and every group at its cheapest."""
    none = np.zeros(pairs.facilities, dtype=bool)
    has_pair = np.diff(pairs.start) > 0
    first = np.minimum(pairs.start[:-1], max(0, len(pairs.cost) - 1))
    cheapest = np.where(has_pair, pairs.cost[first], pairs.outside) if len(pairs.cost) else pairs.outside
    return PairsSolution(none, float(pairs.outside.sum()), False, Certificate.of(cheapest))

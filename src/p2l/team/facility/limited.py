"""Facility location where what is opened is limited: Σ_j w_kj y_j <= B_k, solved with prices on the limits.

A price λ_k on each limit makes it part of the opening costs: L(v, λ) = Σ_i v_i - Σ_k λ_k B_k + Σ_j min(0, f_j + Σ_k λ_k
w_kj - Σ_i (v_i - c_ij)⁺) bounds every plan within the limits. At the root, prices move along the weights that the
volume algorithm's estimate of the relaxation takes too much or too little of; nodes go on from their parents' prices.
Where the limits leave no room, branching ends at open sets, so a gap that no price closes is closed all the same.
"""

from __future__ import annotations

import functools
import heapq
import math
from typing import NamedTuple

import numpy as np

from p2l.records import Array, BoolArray, IntArray
from p2l.team.facility.alarm import Alarm, silent
from p2l.team.facility.branch import Target
from p2l.team.facility.dual_ascent import dual_ascent
from p2l.team.facility.fixing import Core, fix, shrink, whole
from p2l.team.facility.interchange import descend_within
from p2l.team.facility.local_search import columns_of, open_cost
from p2l.team.facility.pairs import Pairs, PairsSolution, of_table
from p2l.team.facility.presolve import presolve_below, solution_cost
from p2l.team.facility.prices import Priced, raise_priced_bound
from p2l.team.facility.tree import Tree
from p2l.team.facility.volume import CLOSED, FREE, OPEN, Bound, State
from p2l.team.problem import Certificate

SLACK = 1e-12  # relative: by how much rounding may put what is taken above its limit
_ROUNDS = 12  # of bound and rounding at the root, unless progress ends earlier
_ROOT_ITERATIONS, _NODE_ITERATIONS = 300, 150  # of the volume algorithm
_THRESHOLDS = (0.05, 0.2, 0.4, 0.6, 0.8)  # of the estimated opening, rounded up to an open set
_ROUNDED_NODES = 40  # these try to improve the plan, afterwards every fifth does


class OpeningLimits(NamedTuple):
    """weights [K, F] of the facilities, and limits [K], raised by what rounding may do."""

    weights: Array
    most: Array

    def keeps(self, open_set: BoolArray) -> bool:
        """Whether an open set [F] is within the limits."""
        return bool((self.weights[:, open_set].sum(axis=1) <= self.most).all())


class Best(NamedTuple):
    """The best plan so far: open set [F] of the whole instance, and its cost."""

    open: BoolArray
    upper: float


@functools.cache
def load_kernels() -> None:
    """Load the compiled kernels, once per process."""
    toy = of_table(np.ones(2), np.array([[0.0, 3.0], [3.0, 0.0], [1.0, 1.0]]))
    none = np.zeros(2, dtype=bool)
    weights, limits = np.ones((1, 2)), np.ones(1)
    descend_within(toy, columns_of(toy), weights, limits, none, ~none)
    core = whole(toy)
    raise_priced_bound(toy, core.state, weights, limits, np.zeros(3), np.zeros(1), 9.0, 1, silent())


def solve_within(pairs: Pairs, weights: Array, limits: Array, *, deadline: float, gap: float = 0.0) -> PairsSolution:
    """Solve an instance within limits to the relative `gap` or until the `deadline` of `time.perf_counter`.

    Args:
        pairs: the instance.
        weights: [K, F] what each facility takes of each limit, at least 0.
        limits: [K] what the open facilities may take together.
        deadline: when to stop with the best solution so far, and what is proven.
        gap: relative gap that is good enough.

    Returns:
        Its cost is infinite where no solution within the limits serves every demand, or none was found in time.
    """
    all_limits = OpeningLimits(weights, limits * (1.0 + SLACK))
    fits = (weights <= all_limits.most[:, None]).all(axis=0)
    with Alarm(deadline) as alarm:
        first = _first_plan(pairs, all_limits, fits, alarm)
        upper = solution_cost(pairs, first)
        small, scale = presolve_below(pairs, upper if math.isfinite(upper) else _everything(pairs, fits), fits)
        best = Best(first, float(open_cost(small, first)))
        core = whole(small)
        serves = np.bincount(small.facility, minlength=small.facilities) > 0  # a case of another would decide nothing
        core = core._replace(state=np.where(fits & serves, core.state, np.int8(CLOSED)))
        v, _ = dual_ascent(small, None, alarm.flag)
        tree = Tree(np.concatenate([v, np.zeros(len(limits))]))
        search = _LimitedSearch(small, all_limits, Target(gap), tree, alarm, best)
        complete = search.run(core, v)
    best = search.best
    full = best.open
    lower = search.target.cutoff(best.upper) if complete else search.lower
    proof = _with_prices(tree.certificate(lower, scale), len(limits))
    return PairsSolution(full, solution_cost(pairs, full), complete, proof)


def _with_prices(certificate: Certificate, count: int) -> Certificate:
    rows = certificate.multipliers
    demands = rows.shape[1] - count
    return Certificate(
        rows[:, :demands], certificate.row, certificate.parent, certificate.facility, certificate.is_open,
        certificate.target, rows[:, demands:],
    )  # fmt: skip


def _everything(pairs: Pairs, fits: BoolArray) -> float:
    """More than any plan costs that serves every demand."""
    opening = pairs.opening[fits & np.isfinite(pairs.opening)].sum()
    service = np.where(np.isfinite(pairs.outside), pairs.outside, 0.0)
    np.maximum.at(service, pairs.rows(), np.where(np.isfinite(pairs.cost), pairs.cost, 0.0))
    return float(opening + service.sum())


def _first_plan(pairs: Pairs, limits: OpeningLimits, fits: BoolArray, alarm: Alarm) -> BoolArray:
    """[F] a plan within the limits; one that serves every demand if that is easy."""
    dear = 1.0 + 2.0 * _everything(pairs, fits)
    table = pairs._replace(
        opening=np.where(fits & np.isfinite(pairs.opening), pairs.opening, dear),
        outside=np.where(np.isfinite(pairs.outside), pairs.outside, dear),
    )
    none = np.zeros(pairs.facilities, dtype=bool)
    return descend_within(table, columns_of(table), *limits, none, fits, alarm.flag)


class _LimitedSearch:
    """Best-first branch and bound with prices; see the module."""

    def __init__(
        self, pairs: Pairs, limits: OpeningLimits, target: Target, tree: Tree, alarm: Alarm, best: Best
    ) -> None:
        self.pairs, self.limits, self.target, self.tree, self.alarm, self.best = (
            pairs,
            limits,
            target,
            tree,
            alarm,
            best,
        )
        self.lower = -math.inf
        self._nodes = 0

    def run(self, core: Core, multipliers: Array) -> bool:
        """Search until proven (True) or until the alarm."""
        root = Priced(Bound(multipliers, 0.0, multipliers, multipliers), np.zeros(len(self.limits.most)), -math.inf)
        for _ in range(_ROUNDS):
            before, upper = root.value, self.best.upper
            root = self._priced(core, root.bound.multipliers, root.prices, _ROOT_ITERATIONS)
            cutoff = self.target.cutoff(self.best.upper)
            is_idle = root.value - before < 0.02 * (cutoff - root.value) and self.best.upper == upper
            if root.value >= cutoff or is_idle or self.alarm.rang:
                break
        self.tree.price(0, self._row(root))
        self.lower = root.value
        heap: list[tuple[float, int, Priced, Core]] = []
        if root.value < self.target.cutoff(self.best.upper):
            self._split(core, 0, root, heap)
        while heap:
            if self.alarm.rang:
                self.lower = min(self.target.cutoff(self.best.upper), heap[0][0])
                return False
            low, serial, parent, case = heapq.heappop(heap)
            if low >= self.target.cutoff(self.best.upper):
                continue
            here = self._priced(case, parent.bound.multipliers, parent.prices, _NODE_ITERATIONS)
            self.tree.price(serial, self._row(here))
            if max(low, here.value) < self.target.cutoff(self.best.upper):
                self._split(case, serial, here, heap, low)
        self.lower = self.target.cutoff(self.best.upper)
        return True

    def _row(self, priced: Priced) -> Array:
        return np.concatenate([priced.bound.multipliers, priced.prices])

    def _within(self, core: Core) -> OpeningLimits:
        return OpeningLimits(self.limits.weights[:, core.origin], self.limits.most)

    def _priced(self, core: Core, multipliers: Array, prices: Array, iterations: int) -> Priced:
        cutoff = self.target.cutoff(self.best.upper)
        limits = self._within(core)
        here = raise_priced_bound(
            core.pairs, core.state, *limits, multipliers, prices, cutoff, iterations, self.alarm.flag
        )
        self._round(core, here, limits)
        return here

    def _round(self, core: Core, priced: Priced, limits: OpeningLimits) -> None:
        self._nodes += 1
        if self._nodes > _ROUNDED_NODES and self._nodes % 5:
            return
        columns = columns_of(core.pairs)
        usable = (priced.bound.share > 0.005) & (core.state != CLOSED)
        seen: set[bytes] = set()
        for threshold in _THRESHOLDS:
            start = (priced.bound.share > threshold) & (core.state != CLOSED) | (core.state == OPEN)
            if self.alarm.rang or start.tobytes() in seen:
                continue
            seen.add(start.tobytes())
            self._offer(core, descend_within(core.pairs, columns, *limits, start, usable, self.alarm.flag))

    def _offer(self, core: Core, open_set: BoolArray) -> None:
        trial = np.zeros(self.pairs.facilities, dtype=bool)
        trial[core.origin[open_set]] = True
        cost = float(open_cost(self.pairs, trial))
        if cost < self.best.upper and self.limits.keeps(trial):
            self.best = Best(trial, cost)

    def _split(
        self, core: Core, serial: int, here: Priced, heap: list[tuple[float, int, Priced, Core]], low: float = -math.inf
    ) -> None:
        """Fix, shrink, and branch; a case without free facilities is a plan."""
        gap = self.target.cutoff(self.best.upper) - here.value
        bound = here.bound
        core = core._replace(state=self._closed(core, fix(core.state, bound, gap)))
        if len(core.pairs.cost) > 500:
            smaller = shrink(core, bound, gap, np.zeros(core.pairs.facilities, dtype=bool), 0.7)
            if smaller is not None:
                core, bound = smaller
                if serial == 0:
                    serial = self.tree.child(serial)
        here = here._replace(bound=bound)
        free = np.flatnonzero(core.state == FREE)
        if not free.size:
            self._offer(core, core.state == OPEN)
            return
        facility = _branching(free, bound)
        for side in (OPEN, CLOSED):
            state = core.state.copy()
            state[facility] = side
            child = self.tree.child(serial, int(core.origin[facility]), is_open=side == OPEN)
            state = self._closed(core, state)
            if not self._possible(core, state):
                continue
            child_low = max(low, here.value + max(0.0, float(bound.reduced_cost[facility]) * side))
            if child_low < self.target.cutoff(self.best.upper):
                heapq.heappush(heap, (child_low, child, here, core._replace(state=state)))

    def _closed(self, core: Core, state: State) -> State:
        """The state in which what no longer fits is closed."""
        limits = self._within(core)
        taken = limits.weights[:, state == OPEN].sum(axis=1)
        too_much = (taken[:, None] + limits.weights > limits.most[:, None]).any(axis=0)
        return np.where((state == FREE) & too_much, np.int8(CLOSED), state)

    def _possible(self, core: Core, state: State) -> bool:
        limits = self._within(core)
        return bool((limits.weights[:, state == OPEN].sum(axis=1) <= limits.most).all())


def _branching(free: IntArray, bound: Bound) -> int:
    return int(free[np.abs(bound.share[free] - 0.5).argmin()])

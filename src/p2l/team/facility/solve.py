"""Exact facility location at scale: dual ascent, local search, volume bound, fixing, Lagrangian branch and bound.

This is the large-scale route of the team planner and of `p2l.team.facility.location`. Every step works on
`Pairs`; what a plan costs is recomputed from the input at the end.
"""

from __future__ import annotations

import functools
import time
from dataclasses import dataclass, replace

import numpy as np

from p2l.records import Array, BoolArray
from p2l.team.facility.branch import Target, branch_and_bound
from p2l.team.facility.dual_ascent import dual_ascent
from p2l.team.facility.fixing import Core, shrink, whole
from p2l.team.facility.greedy import greedy_solution
from p2l.team.facility.local_search import Columns, columns_of, descend, open_cost
from p2l.team.facility.pairs import Pairs, PairsSolution, of_table
from p2l.team.facility.volume import Bound, bound_of, raise_bound
from p2l.team.problem import Status

_ROUNDS = 20  # of bound, rounding and fixing at the root, unless progress ends earlier
_ITERATIONS = 300  # of the volume algorithm per round
_THRESHOLDS = (0.05, 0.2, 0.4, 0.6, 0.8)  # of the estimated opening, rounded up to an open set


@dataclass(frozen=True)
class Root:
    """What the root knows: the core left to decide, the best plan in the core's indices, its cost, the best bound."""

    core: Core
    open: BoolArray
    upper: float
    bound: Bound


@functools.cache
def load_kernels() -> None:
    """Load the compiled kernels, once per process, so that no time limit pays for it.

    On a fresh installation they are compiled here, for about fifteen seconds, and cached on disk.
    """
    toy = of_table(np.ones(2), np.array([[0.0, 3.0], [3.0, 0.0], [1.0, 1.0]]))
    multipliers, open_set = dual_ascent(toy)
    greedy_solution(toy)
    open_set = descend(toy, columns_of(toy), open_set, ~open_set)
    raise_bound(toy, whole(toy).state, multipliers, float(open_cost(toy, open_set)), 1)
    bound_of(toy, whole(toy).state, multipliers)


def solve_pairs(pairs: Pairs, *, deadline: float, gap: float = 0.0) -> PairsSolution:
    """Solve an instance to the relative `gap` or until the `deadline` of `time.perf_counter`."""
    target = Target(gap, _unit(pairs))
    root, proofs = _tighten(_start(pairs, *dual_ascent(pairs), deadline), target, deadline)
    open_set, upper, lower = root.open, root.upper, root.bound.value
    complete = lower >= target.cutoff(upper)
    if not complete and time.perf_counter() < deadline:
        search = branch_and_bound(root.core, root.bound, root.open, root.upper, target, deadline)
        open_set, upper, lower, complete = search.open, search.upper, max(lower, search.lower), search.complete
    elif complete:
        lower = target.proven(upper)
    full = np.zeros(pairs.facilities, dtype=bool)
    full[root.core.origin[open_set]] = True
    blank = np.zeros(pairs.facilities, dtype=np.int8)
    best = max(proofs, key=lambda v: bound_of(pairs, blank, v))
    lower = min(upper, max(min(lower, target.proven(upper)), bound_of(pairs, blank, best)))
    status: Status = "time_limit" if not complete else "optimal" if lower >= upper * (1.0 - 1e-9) else "feasible"
    return PairsSolution(full, float(open_cost(pairs, full)), lower, status, best)


def dual_ascent_solution(pairs: Pairs) -> tuple[BoolArray, Array]:
    """The open set [F] that dual ascent suggests, after local search in it, and multipliers [D] that sum to a bound."""
    multipliers, suggestion = dual_ascent(pairs)
    return descend(pairs, columns_of(pairs), suggestion, suggestion), multipliers


def _unit(pairs: Pairs) -> float:
    integral = all(bool((part == np.floor(part)).all()) for part in (pairs.opening, pairs.outside, pairs.cost))
    return 1.0 if integral else 0.0


def _start(pairs: Pairs, multipliers: Array, suggestion: BoolArray, deadline: float) -> Root:
    core = whole(pairs)
    open_set = suggestion
    if time.perf_counter() < deadline:
        open_set = descend(pairs, columns_of(pairs), suggestion, np.ones(pairs.facilities, dtype=bool))
    bound = raise_bound(pairs, core.state, multipliers, np.inf, 0)
    return Root(core, open_set, float(open_cost(pairs, open_set)), bound)


def _tighten(root: Root, target: Target, deadline: float) -> tuple[Root, list[Array]]:
    """Alternate bound, rounding and fixing while they make progress; also the multipliers worth keeping as proof."""
    columns = columns_of(root.core.pairs)
    proofs = [root.bound.multipliers]
    idle = 0
    for _ in range(_ROUNDS):
        if idle == 2 or root.bound.value >= target.cutoff(root.upper) or time.perf_counter() > deadline:
            break
        cutoff = target.cutoff(root.upper)
        bound = raise_bound(root.core.pairs, root.core.state, root.bound.multipliers, cutoff, _ITERATIONS)
        open_set, upper = _round(root, columns, bound, deadline)
        gain = bound.value - root.bound.value
        idle = 0 if upper < root.upper or gain > 0.02 * (upper - bound.value) else idle + 1
        root = replace(root, open=open_set, upper=upper, bound=bound)
        if root.core.pairs.facilities == len(root.core.origin):
            proofs = [*proofs[:1], bound.multipliers]
        root, columns = _shrunk(root, columns, target)
    return root, [*proofs, root.bound.multipliers]


def _round(root: Root, columns: Columns, bound: Bound, deadline: float) -> tuple[BoolArray, float]:
    """The best plan among roundings of the estimated opening, each descended on the facilities it suggests."""
    best, upper = root.open, root.upper
    for threshold in _THRESHOLDS:
        if time.perf_counter() > deadline:
            break
        trial = descend(root.core.pairs, columns, bound.share > threshold, (bound.share > 0.005) | best)
        cost = float(open_cost(root.core.pairs, trial))
        if cost < upper:
            best, upper = trial, cost
    return best, upper


def _shrunk(root: Root, columns: Columns, target: Target) -> tuple[Root, Columns]:
    """The root on a smaller core, where fixing removes enough to pay for rebuilding it."""
    gap = target.cutoff(root.upper) - root.bound.value
    if gap <= 0.0:
        return root, columns
    core, bound = shrink(root.core, root.bound, gap, root.open)
    if len(core.pairs.cost) > 0.7 * len(root.core.pairs.cost):
        return root, columns
    rest = np.isin(root.core.origin, core.origin)
    return Root(core, root.open[rest], root.upper, bound), columns_of(core.pairs)

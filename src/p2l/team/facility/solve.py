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
from p2l.team.facility.greedy import greedy
from p2l.team.facility.local_search import Columns, columns_of, descend, open_cost
from p2l.team.facility.pairs import Answer, Pairs, of_table
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
    multipliers, opened = dual_ascent(toy)
    greedy(toy)
    opened = descend(toy, columns_of(toy), opened, ~opened)
    raise_bound(toy, whole(toy).state, multipliers, float(open_cost(toy, opened)), 1)
    bound_of(toy, whole(toy).state, multipliers)


def solve_pairs(pairs: Pairs, *, deadline: float, gap: float = 0.0) -> Answer:
    """Solve an instance to the relative `gap` or until the `deadline` of `time.perf_counter`."""
    target = Target(gap, _unit(pairs))
    start, suggested = dual_ascent(pairs)
    first = _start(pairs, start, suggested, deadline)
    root, proofs = _tighten(first, target, deadline)
    opened, upper, lower = root.open, root.upper, root.bound.value
    finished = lower >= target.cutoff(upper)
    if not finished and time.perf_counter() < deadline:
        search = branch_and_bound(root.core, root.bound, root.open, root.upper, target, deadline)
        opened, upper, lower, finished = search.open, search.upper, max(lower, search.lower), search.finished
    elif finished:
        lower = target.proven(upper)
    full = np.zeros(pairs.facilities, dtype=bool)
    full[root.core.origin[opened]] = True
    blank = np.zeros(pairs.facilities, dtype=np.int8)
    best = max(proofs, key=lambda v: bound_of(pairs, blank, v))
    lower = min(upper, max(min(lower, target.proven(upper)), bound_of(pairs, blank, best)))
    status: Status = "time_limit" if not finished else "optimal" if lower >= upper * (1.0 - 1e-9) else "feasible"
    return Answer(full, float(open_cost(pairs, full)), lower, status, best)


def _unit(pairs: Pairs) -> float:
    integral = all(bool((part == np.floor(part)).all()) for part in (pairs.opening, pairs.outside, pairs.cost))
    return 1.0 if integral else 0.0


def _start(pairs: Pairs, multipliers: Array, suggested: BoolArray, deadline: float) -> Root:
    core = whole(pairs)
    opened = suggested
    if time.perf_counter() < deadline:
        opened = descend(pairs, columns_of(pairs), suggested, np.ones(pairs.facilities, dtype=bool))
    bound = raise_bound(pairs, core.state, multipliers, np.inf, 0)
    return Root(core, opened, float(open_cost(pairs, opened)), bound)


def _tighten(root: Root, target: Target, deadline: float) -> tuple[Root, list[Array]]:
    """Alternate bound, rounding and fixing while they make progress; also the multipliers worth keeping as proof."""
    columns = columns_of(root.core.pairs)
    proofs = [root.bound.multipliers]
    idle = 0
    for _ in range(_ROUNDS):
        if idle == 2 or root.bound.value >= target.cutoff(root.upper) or time.perf_counter() > deadline:
            break
        cutoff = target.cutoff(root.upper)
        found = raise_bound(root.core.pairs, root.core.state, root.bound.multipliers, cutoff, _ITERATIONS)
        opened, upper = _round(root, columns, found, deadline)
        gained = found.value - root.bound.value
        idle = 0 if upper < root.upper or gained > 0.02 * (upper - found.value) else idle + 1
        root = replace(root, open=opened, upper=upper, bound=found)
        if root.core.pairs.facilities == len(root.core.origin):
            proofs = [*proofs[:1], found.multipliers]
        root, columns = _shrunk(root, columns, target)
    return root, [*proofs, root.bound.multipliers]


def _round(root: Root, columns: Columns, found: Bound, deadline: float) -> tuple[BoolArray, float]:
    """The best plan among roundings of the estimated opening, each descended on the facilities it suggests."""
    best, upper = root.open, root.upper
    for threshold in _THRESHOLDS:
        if time.perf_counter() > deadline:
            break
        trial = descend(root.core.pairs, columns, found.share > threshold, (found.share > 0.005) | best)
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
    kept = np.isin(root.core.origin, core.origin)
    return Root(core, root.open[kept], root.upper, bound), columns_of(core.pairs)

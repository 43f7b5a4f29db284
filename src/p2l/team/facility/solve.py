"""Exact facility location at scale: dual ascent, local and tabu search, volume bound, fixing, branch and bound.

This is the large-scale route of the team planner and of `p2l.team.facility.location`. Every step works on
`Pairs`; what a plan costs is recomputed from the input at the end.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace

import numpy as np

from p2l.records import Array, BoolArray
from p2l.team.facility.alarm import Alarm, silent
from p2l.team.facility.branch import Incumbent, Search, Target, branch_and_bound
from p2l.team.facility.count import count_cases, whole_search
from p2l.team.facility.covering import cover
from p2l.team.facility.dual_ascent import dual_ascent
from p2l.team.facility.fixing import Core, shrink, whole
from p2l.team.facility.greedy import greedy_solution
from p2l.team.facility.local_search import Columns, columns_of, descend, open_cost
from p2l.team.facility.pairs import Pairs, PairsSolution, of_table
from p2l.team.facility.presolve import presolve, solution_cost
from p2l.team.facility.tabu import Trail, wander
from p2l.team.facility.tree import Tree
from p2l.team.facility.volume import Bound, bound_of, raise_bound
from p2l.team.facility.walk import Walk

_ROUNDS = 20  # of bound, rounding and fixing at the root, unless progress ends earlier
_ITERATIONS = 300  # of the volume algorithm per round
_PATIENCE = 3e8  # steps of tabu search without a better plan, per relative gap
_LONGEST, _MOST = 600.0, 6e7  # steps at most, per facility and pair, and at all
_SEED = 0  # of the tabu search
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
    """Load the compiled kernels, once per process.

    On a fresh installation they are compiled here, for about fifteen seconds, and cached on disk.
    """
    toy = of_table(np.ones(2), np.array([[0.0, 3.0], [3.0, 0.0], [1.0, 1.0]]))
    multipliers, open_set = dual_ascent(toy)
    greedy_solution(toy)
    open_set = descend(toy, columns_of(toy), open_set, ~open_set)
    upper = float(open_cost(toy, open_set))
    bound = raise_bound(toy, whole(toy).state, multipliers, upper, 1)
    shrink(whole(toy), bound, 1.0, open_set)
    trail, rng = Trail(open_set, upper, open_set), np.random.default_rng(_SEED)
    wander(toy, columns_of(toy), trail, 1.0, rng, steepest=True)
    cover(toy, columns_of(toy), trail, 1, 1.0, rng, silent())
    bound_of(toy, whole(toy).state, multipliers)


def solve_pairs(
    pairs: Pairs,
    *,
    deadline: float,
    gap: float = 0.0,
    multipliers: Array | None = None,
    open_set: BoolArray | None = None,
    whole_numbers: bool = False,
    counting: bool = False,
) -> PairsSolution:
    """Solve an instance to the relative `gap` or until the `deadline` of `time.perf_counter`.

    Args:
        pairs: the instance.
        deadline: when to stop with the best solution so far, and what is proven.
        gap: relative gap that is good enough.
        multipliers: [D] where to begin; dual ascent otherwise.
        open_set: [F] a solution that is known already.
        whole_numbers: all costs are, and the checker knows.
        counting: whether the proof may have cases of how many facilities are open.
    """
    small, scale, known = presolve(pairs)
    with Alarm(deadline) as alarm:
        v, suggestion = dual_ascent(small, None if multipliers is None else multipliers * scale, alarm.flag)
        known = min(
            (each for each in (known, suggestion, open_set) if each is not None),
            key=lambda each: float(open_cost(small, each)),
        )
        target = Target(gap, scale if whole_numbers else 0.0)
        root, tree, node = _tighten(_start(small, v, known, alarm), target, alarm)
        best, upper, lower = root.open, root.upper, root.bound.value
        complete = lower >= target.cutoff(upper)
        if not complete and not alarm.rang:
            root, node, walk = _improved(root, target, tree, node, alarm)
            (best, upper), proven, complete = _search(root, target, tree, node, walk, alarm, counting=counting)
            lower = max(lower, proven)
    full = np.zeros(pairs.facilities, dtype=bool)
    full[root.core.origin[best]] = True
    proof = tree.certificate(target.cutoff(upper) if complete else lower, scale)
    return PairsSolution(full, solution_cost(pairs, full), complete, proof)


def greedy_lessons(pairs: Pairs, deadline: float) -> tuple[BoolArray, Array]:
    """The open set [F] of the greedy algorithm, and multipliers [D] whose sum is a bound."""
    small, scale, _ = presolve(pairs)
    with Alarm(deadline) as alarm:
        open_set, multipliers = greedy_solution(small, alarm.flag)
    return open_set, multipliers / scale


def dual_ascent_lessons(pairs: Pairs, deadline: float) -> tuple[BoolArray, Array]:
    """The open set [F] that dual ascent suggests, after local search in it, and multipliers [D] that sum to a bound."""
    small, scale, _ = presolve(pairs)
    with Alarm(deadline) as alarm:
        multipliers, suggestion = dual_ascent(small, None, alarm.flag)
        return descend(small, columns_of(small), suggestion, suggestion, alarm.flag), multipliers / scale


def _start(pairs: Pairs, multipliers: Array, known: BoolArray, alarm: Alarm) -> Root:
    core = whole(pairs)
    open_set = known
    if not alarm.rang:
        open_set = descend(pairs, columns_of(pairs), known, np.ones(pairs.facilities, dtype=bool), alarm.flag)
    bound = raise_bound(pairs, core.state, multipliers, np.inf, 0)
    return Root(core, open_set, float(open_cost(pairs, open_set)), bound)


def _tighten(root: Root, target: Target, alarm: Alarm) -> tuple[Root, Tree, int]:
    """Alternate bound, rounding and fixing while they make progress; also the tree, and where the search goes on."""
    tree, node = Tree(root.bound.multipliers, root.core.pairs.facilities), 0
    columns = columns_of(root.core.pairs)
    idle = 0
    for _ in range(_ROUNDS):
        if idle == 2 or root.bound.value >= target.cutoff(root.upper) or alarm.rang:
            break
        cutoff = target.cutoff(root.upper)
        pairs, state = root.core.pairs, root.core.state
        bound = raise_bound(pairs, state, root.bound.multipliers, cutoff, _ITERATIONS, flag=alarm.flag)
        tree.price(node, bound.multipliers)
        open_set, upper = _round(root, columns, bound, alarm)
        gain = bound.value - root.bound.value
        idle = 0 if upper < root.upper or gain > 0.02 * (upper - bound.value) else idle + 1
        root = replace(root, open=open_set, upper=upper, bound=bound)
        if (smaller := _shrunk(root, target)) is not None:
            root, columns = smaller
            node = tree.child(node)
    return root, tree, node


def _improved(root: Root, target: Target, tree: Tree, node: int, alarm: Alarm) -> tuple[Root, int, Walk]:
    """The root with the plan that a tabu search finds, and what that fixes; also the node, and the search itself."""
    rng = np.random.default_rng(_SEED)
    walk = Walk(root.core.pairs, root.open, root.upper, rng)
    gap = (root.upper - root.bound.value) / root.upper if root.upper > 0.0 else 0.0
    most = min(_MOST, _LONGEST * root.core.pairs.facilities * len(root.core.pairs.cost))
    trail = walk.patiently(min(most, _PATIENCE * gap), alarm.flag)
    if trail.cost >= root.upper:
        return root, node, walk
    root = replace(root, open=trail.best, upper=trail.cost)
    if (smaller := _shrunk(root, target)) is None:
        return root, node, walk
    root = smaller[0]
    return root, tree.child(node), Walk(root.core.pairs, root.open, root.upper, rng)


def _search(root: Root, target: Target, tree: Tree, node: int, walk: Walk, alarm: Alarm, *, counting: bool) -> Search:
    """Branch and bound, in cases of how many facilities are open where that says much."""
    parts = [whole_search(root.core, root.bound, node)]
    if counting:
        parts = count_cases(parts[0], root.open, root.upper, target.cutoff(root.upper), tree, alarm)
    best, lower, complete = Incumbent(root.open, root.upper), math.inf, True
    for part in parts:
        search = branch_and_bound(root.core, part, best, target, tree, walk, alarm)
        best, complete = search.best, complete and search.complete
        lower = min(lower, search.lower)
    return Search(best, lower, complete)


def _round(root: Root, columns: Columns, bound: Bound, alarm: Alarm) -> tuple[BoolArray, float]:
    """The best plan among roundings of the estimated opening, each descended on the facilities it suggests."""
    best, upper = root.open, root.upper
    for threshold in _THRESHOLDS:
        if alarm.rang:
            break
        usable = (bound.share > 0.005) | best
        trial = descend(root.core.pairs, columns, bound.share > threshold, usable, alarm.flag)
        cost = float(open_cost(root.core.pairs, trial))
        if cost < upper:
            best, upper = trial, cost
    return best, upper


def _shrunk(root: Root, target: Target) -> tuple[Root, Columns] | None:
    """The root on a smaller core, where fixing removes enough to pay for rebuilding it."""
    gap = target.cutoff(root.upper) - root.bound.value
    if gap <= 0.0:
        return None
    smaller = shrink(root.core, root.bound, gap, root.open, 0.7)
    if smaller is None:
        return None
    core, bound = smaller
    rest = np.isin(root.core.origin, core.origin)
    return Root(core, root.open[rest], root.upper, bound), columns_of(core.pairs)

"""Lagrangian branch and bound on the core that fixing leaves.

A node is a partial choice of facilities and the multipliers of its parent. A few volume iterations raise its bound,
reduced costs fix facilities and pairs (a node's bound is tighter than the root's, so its instance soon shrinks), and
the facility whose estimated opening is nearest to one half is branched on. The node with the lowest bound comes first,
so the bound of an interrupted search is the best that its tree can prove. Every node leaves its multipliers in the
tree that is the proof. Where the gap is large, a tabu search goes on beside the tree, for a share of its work.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from p2l.records import Array, BoolArray, IntArray
from p2l.team.facility.alarm import Alarm
from p2l.team.facility.count import CountCase
from p2l.team.facility.fixing import Core, fix, shrink
from p2l.team.facility.local_search import columns_of, descend, open_cost
from p2l.team.facility.tree import Tree
from p2l.team.facility.volume import CLOSED, FREE, OPEN, Bound, Pace, raise_bound
from p2l.team.facility.walk import Walk

_ITERATIONS = 150  # of the volume algorithm per node at most
_WIDE_PACE = Pace(step=0.1, look=30, progress=0.2)  # a node that comes no nearer to the plan is split
_PACE = Pace(step=0.03, look=60, progress=0.4)
_WIDE = 0.05  # from this relative gap on, nodes take wide steps
_ROUNDED_NODES = 20  # these try to improve the plan, afterwards every tenth does
_WALKED = 60  # iterations per node that a tabu search's share is counted by
_WORTH_SHRINKING = 500  # pairs; a smaller instance costs nothing to evaluate
_READ = 10  # pairs of a demand that an iteration reads, about, where it has many
_WALK = 4e6  # steps of tabu search at a time
_MEMORY = 1_000_000_000  # bytes of open nodes; beyond, the search goes depth first
_MARGIN = 5e-10  # relative: half of what the certificate grants, the rest is for rounding


@dataclass(frozen=True)
class Target:
    """What a bound must reach. A plan counts as better only if it saves more than the margin.

    Attributes:
        gap: relative gap that the caller accepts.
        unit: every plan's cost is a multiple of it; 0 when costs are not integers.
    """

    gap: float = 0.0
    unit: float = 0.0

    def cutoff(self, upper: float) -> float:
        """The bound from which on no plan is better than `upper` by more than the margin."""
        return upper - max(max(self.gap, _MARGIN) * upper, self.unit * (1.0 - 1e-3))


class Node(NamedTuple):
    """An open node; `serial`, its number in the tree, breaks ties. Siblings share multipliers and pairs."""

    bound: float
    serial: int
    multipliers: Array
    core: Core
    size: int


@dataclass
class Frontier:
    """Open nodes, lowest bound first; depth first while they would not fit in memory."""

    heap: list[Node] = field(default_factory=list)
    stack: list[Node] = field(default_factory=list)
    memory: int = 0

    def push(self, bound: float, serial: int, multipliers: Array, core: Core, shared_bytes: int) -> None:
        """Add a node; `shared_bytes` are what it and its sibling hold together."""
        node = Node(bound, serial, multipliers, core, core.state.nbytes + shared_bytes // 2)
        self.memory += node.size
        if self.memory > _MEMORY:
            self.stack.append(node)
        else:
            heapq.heappush(self.heap, node)

    def pop(self) -> Node:
        """Remove the node to look at next."""
        node = self.stack.pop() if self.stack else heapq.heappop(self.heap)
        self.memory -= node.size
        return node

    def lowest(self, otherwise: float) -> float:
        """The lowest bound of all open nodes."""
        return min([otherwise, *(node.bound for node in self.stack), *(node.bound for node in self.heap[:1])])

    def __bool__(self) -> bool:
        return bool(self.stack or self.heap)


class Incumbent(NamedTuple):
    """The best plan so far: open set [F] in the root core's indices, and its cost."""

    open: BoolArray
    upper: float

    def or_better(self, root: Core, node: Core, open_set: BoolArray) -> Incumbent:
        """The cheaper of this plan and an open set in a node's indices."""
        trial = np.zeros_like(self.open)
        trial[np.searchsorted(root.origin, node.origin[open_set])] = True
        cost = float(open_cost(root.pairs, trial))
        return Incumbent(trial, cost) if cost < self.upper else self

    def after(self, walk: Walk, steps: float, alarm: Alarm) -> Incumbent:
        """The cheaper of this plan and what a walk finds that goes on for some steps."""
        if self.upper < walk.cost:
            walk.goes_on_from(self.open, self.upper)
        trail = walk.further(steps, alarm.flag)
        return Incumbent(trail.best, trail.cost) if trail.cost < self.upper else self


class Search(NamedTuple):
    """Result of a search: the best plan, what its tree proves, and whether that was exhausted."""

    best: Incumbent
    lower: float
    complete: bool


def branch_and_bound(
    root: Core, part: CountCase, best: Incumbent, target: Target, tree: Tree, walk: Walk, alarm: Alarm
) -> Search:
    """Search a part for a plan better than the best so far, until proven or until the alarm.

    Args:
        root: the core whose indices the plan has, with its true costs.
        part: what is to be searched, and the prices to do so in.
        best: the best plan so far.
        target: when a bound is good enough.
        tree: the proof so far.
        walk: a search for better plans of the root core that is to go on meanwhile.
        alarm: ends it.
    """
    frontier = Frontier()
    frontier.push(part.bound.value, part.node, part.bound.multipliers, part.core, 0)
    share, steps, nodes = _walk_share(part.bound.value + part.offset, best.upper), 0.0, 0
    gap = target.cutoff(best.upper) - part.offset - part.bound.value
    pace = _WIDE_PACE if gap > _WIDE * (part.bound.value + gap) else _PACE
    while frontier:
        if alarm.rang:
            return Search(best, _left(part, frontier, target.cutoff(best.upper), tree), False)
        case = frontier.pop()
        cutoff = target.cutoff(best.upper) - part.offset
        if case.bound >= cutoff:
            continue
        core = case.core
        v, state = case.multipliers, core.state
        case_bound = raise_bound(core.pairs, state, v, cutoff, _ITERATIONS, alarm.flag, pace)
        tree.price(case.serial, case_bound.multipliers, part.price)
        if nodes < _ROUNDED_NODES or nodes % 10 == 0:
            best = best.or_better(root, core, _rounding(core, case_bound))
        nodes += 1
        steps += share * _WALKED * min(len(core.pairs.cost), _READ * core.pairs.demands)
        if steps >= _WALK:
            best, steps = best.after(walk, steps, alarm), 0.0
        cutoff = target.cutoff(best.upper) - part.offset
        if max(case.bound, case_bound.value) < cutoff:
            best = _split(root, case, case_bound, cutoff, frontier, best, tree)
    return Search(best, target.cutoff(best.upper), True)


def _left(part: CountCase, frontier: Frontier, cutoff: float, tree: Tree) -> float:
    """The bound that an interrupted search proves.

    Where its prices say little about costs, its open nodes are priced once more, in true ones, if that says more.
    """
    if part.price >= 0.0:
        return frontier.lowest(cutoff - part.offset) + part.offset
    lowest = cutoff
    for node in [*frontier.stack, *frontier.heap]:
        v, bound = part.true_bound(node.core, node.multipliers)
        if bound > node.bound + part.offset:
            tree.price(node.serial, v)
        lowest = min(lowest, max(bound, node.bound + part.offset))
    return lowest


def _walk_share(lower: float, upper: float) -> float:
    """Steps of tabu search per pair that the bound reads: more of them where a better plan is likely."""
    return min(1.0, max(0.02, 4.0 * (upper - lower) / upper)) if upper > 0.0 else 0.0


def _rounding(core: Core, bound: Bound) -> BoolArray:
    trial = ((bound.share > 0.5) & (core.state != CLOSED)) | (core.state == OPEN)
    return descend(core.pairs, columns_of(core.pairs), trial, bound.share > 0.005)


def _split(
    root: Core, node: Node, bound: Bound, cutoff: float, frontier: Frontier, best: Incumbent, tree: Tree
) -> Incumbent:
    """Push the children of a node; a node without free facilities is a plan."""
    gap = cutoff - bound.value
    core = node.core._replace(state=fix(node.core.state, bound, gap))
    shared_bytes = bound.multipliers.nbytes
    if len(core.pairs.cost) > _WORTH_SHRINKING:
        smaller = shrink(core, bound, gap, np.zeros(core.pairs.facilities, dtype=bool), 0.6)
        if smaller is not None:
            (core, bound), shared_bytes = smaller, shared_bytes + 12 * len(smaller[0].pairs.cost)
    free = np.flatnonzero(core.state == FREE)
    if not free.size:
        return best.or_better(root, core, core.state == OPEN)
    facility = _branching(free, bound)
    for side in (OPEN, CLOSED):
        state = core.state.copy()
        state[facility] = side
        child = tree.child(node.serial, int(core.origin[facility]), is_open=side == OPEN)
        child_bound = max(node.bound, bound.value + max(0.0, float(bound.reduced_cost[facility]) * side))
        if child_bound < cutoff:
            frontier.push(child_bound, child, bound.multipliers, core._replace(state=state), shared_bytes)
    return best


def _branching(free: IntArray, bound: Bound) -> int:
    """The free facility that the relaxation is least sure about."""
    return int(free[np.abs(bound.share[free] - 0.5).argmin()])

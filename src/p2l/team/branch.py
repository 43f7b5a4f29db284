"""Lagrangian branch and bound on the core that fixing leaves.

A node is a partial choice of facilities and the multipliers of its parent; a few volume iterations raise its bound,
reduced costs fix more facilities, and the facility whose estimated opening is nearest to one half is branched on. The
node with the lowest bound comes first, so the bound of an interrupted search is the best that its tree can prove.
"""

from __future__ import annotations

import heapq
import time
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from p2l.records import Array, BoolArray
from p2l.team.fixing import Core, fix
from p2l.team.local_search import Columns, columns_of, descend, open_cost
from p2l.team.volume import CLOSED, FREE, OPEN, Bound, State, raise_bound

_ITERATIONS = 60  # of the volume algorithm per node
_ROUNDED_NODES = 20  # these try to improve the plan, afterwards every tenth does
_MEMORY = 512_000_000  # bytes of open nodes; beyond, the search goes depth first


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
        return upper - max(max(self.gap, 1e-9) * upper, self.unit * (1.0 - 1e-6))


class Search(NamedTuple):
    """Result of a search: best open set [F] and cost, a lower bound, and whether the tree was exhausted."""

    open: BoolArray
    upper: float
    lower: float
    finished: bool


class Node(NamedTuple):
    """An open node; `serial` breaks ties before arrays are compared."""

    bound: float
    serial: int
    multipliers: Array
    state: State


@dataclass
class Frontier:
    """Open nodes, lowest bound first; depth first while they would not fit in memory."""

    heap: list[Node] = field(default_factory=list)
    stack: list[Node] = field(default_factory=list)
    serial: int = 0

    def push(self, bound: float, multipliers: Array, state: State) -> None:
        """Add a node."""
        node = Node(bound, self.serial, multipliers, state)
        self.serial += 1
        if len(self.heap) * (multipliers.nbytes // 2 + state.nbytes) > _MEMORY:  # siblings share multipliers
            self.stack.append(node)
        else:
            heapq.heappush(self.heap, node)

    def pop(self) -> Node:
        """Remove the node to look at next."""
        return self.stack.pop() if self.stack else heapq.heappop(self.heap)

    def lowest(self, otherwise: float) -> float:
        """The lowest bound of all open nodes."""
        return min([otherwise, *(node.bound for node in self.stack), *(node.bound for node in self.heap[:1])])

    def __bool__(self) -> bool:
        return bool(self.stack or self.heap)


def branch_and_bound(
    core: Core, bound: Bound, opened: BoolArray, upper: float, target: Target, deadline: float
) -> Search:
    """Search the core for a plan better than `upper`, until proven or until the deadline.

    Args:
        core: what is left to decide.
        bound: the root's bound.
        opened: [F] the known plan, in the core's indices.
        upper: its cost.
        target: when a bound is good enough.
        deadline: of `time.perf_counter`.
    """
    columns = columns_of(core.pairs)
    frontier = Frontier()
    frontier.push(bound.value, bound.multipliers, core.state)
    nodes = 0
    while frontier:
        if time.perf_counter() > deadline:
            return Search(opened, upper, frontier.lowest(upper), False)
        node = frontier.pop()
        if node.bound >= target.cutoff(upper):
            continue
        found = raise_bound(core.pairs, node.state, node.multipliers, target.cutoff(upper), _ITERATIONS)
        if nodes < _ROUNDED_NODES or nodes % 10 == 0:
            opened, upper = _round(core, columns, node.state, found, opened, upper)
        nodes += 1
        opened, upper = _split(core, node, found, frontier, opened, upper, target)
    return Search(opened, upper, max(bound.value, target.cutoff(upper)) if target.gap else upper, True)


def _round(
    core: Core, columns: Columns, state: State, found: Bound, opened: BoolArray, upper: float
) -> tuple[BoolArray, float]:
    trial = ((found.share > 0.5) & (state != CLOSED)) | (state == OPEN)
    trial = descend(core.pairs, columns, trial, found.share > 0.005)
    cost = open_cost(core.pairs, trial)
    return (trial, cost) if cost < upper else (opened, upper)


def _split(
    core: Core, node: Node, found: Bound, frontier: Frontier, opened: BoolArray, upper: float, target: Target
) -> tuple[BoolArray, float]:
    """Push the children of a node that cannot be discarded; a node without free facilities is a plan."""
    value = max(node.bound, found.value)
    cutoff = target.cutoff(upper)
    if value >= cutoff:
        return opened, upper
    state = fix(node.state, found, cutoff - found.value)
    free = np.flatnonzero(state == FREE)
    if not free.size:
        leaf = state == OPEN
        cost = open_cost(core.pairs, leaf)
        return (leaf, cost) if cost < upper else (opened, upper)
    chosen = free[np.abs(found.share[free] - 0.5).argmin()]
    for side in (OPEN, CLOSED):
        child = state.copy()
        child[chosen] = side
        implied = max(value, found.value + max(0.0, float(found.reduced[chosen]) * side))
        if implied < cutoff:
            frontier.push(implied, found.multipliers, child)
    return opened, upper

"""The order of work of a plan, and circles among its lessons where there is none.

A group has to wait for the lesson that it uses, and for what comes before it in the partial order. Where the lessons
that are cheapest for each group make some of them wait for each other, the circle's pairs are handed back.
"""

from __future__ import annotations

import heapq

import numpy as np

from p2l.records import BoolArray, IntArray
from p2l.team.shop.record import Shop, precedence
from p2l.team.shop.reduction import Reduction, outside_costs

Pair = tuple[int, int]


def circle_of(shop: Shop, reduction: Reduction, open_set: BoolArray) -> tuple[list[Pair], IntArray]:
    """Pairs (lesson, group) of a circle among the cheapest services of an open set [F], or the order of work [G]."""
    lesson = _lessons_used(shop, reduction, open_set)
    before = [(int(shop.completes[each]), group) for group, each in enumerate(lesson.tolist()) if each >= 0]
    waits = [(first, group) for first, group in before if first >= 0 and first != group]
    if shop.order != "partial":
        taught = np.unique(reduction.lesson[open_set])
        return [], sequence_of(shop, np.stack([taught, np.zeros_like(taught)], axis=1))
    sequence, stuck = _sorted(shop, waits, np.isin(np.arange(len(lesson)), [first for first, _ in waits]))
    if not stuck:
        return [], sequence
    way = _circle(shop, waits, stuck)
    return [(int(lesson[group]), group) for group in way], sequence


def sequence_of(shop: Shop, taught: IntArray) -> IntArray:
    """[G] an order of work that keeps the shop's and has lessons [T, 2] as early as that allows."""
    task, _ = shop.groups
    is_lesson = np.zeros(len(task), dtype=bool)
    own = shop.completes[taught[:, 0]]
    is_lesson[own[own >= 0]] = True
    if shop.order == "fixed":
        return np.lexsort((np.arange(len(task)), task))
    if shop.order == "any":
        return np.lexsort((np.arange(len(task)), task, ~is_lesson))
    needed = is_lesson.copy()
    for first, second in reversed(_arcs_in_order(shop)):  # what a lesson waits for comes early, too
        needed[first] |= needed[second]
    return _sorted(shop, [], needed)[0]


def _lessons_used(shop: Shop, reduction: Reduction, open_set: BoolArray) -> IntArray:
    """[G] the lesson that serves each group at least cost, -1 for none."""
    pairs = reduction.pairs
    used = np.full(pairs.demands, -1, dtype=np.int64)
    rows = pairs.rows()
    place = np.flatnonzero(open_set[pairs.facility])
    demand, first = np.unique(rows[place], return_index=True)
    used[demand] = reduction.lesson[pairs.facility[place[first]]]
    outside = outside_costs(shop)
    cost = np.full(pairs.demands, np.inf)
    cost[demand] = pairs.cost[place[first]]
    used[cost >= outside] = -1
    return used


def _arcs(shop: Shop) -> list[tuple[int, int]]:
    """Arcs between groups: the partial order for all copies, and first copies before the others."""
    task, _ = shop.groups
    of_task: list[list[int]] = [[] for _ in range(shop.n)]
    for group, i in enumerate(task.tolist()):
        of_task[i].append(group)
    arcs = [(a, b) for one, two in shop.arcs.tolist() for a in of_task[one] for b in of_task[two]]
    return arcs + [(groups[0], each) for groups in of_task for each in groups[1:]]


def _arcs_in_order(shop: Shop) -> list[tuple[int, int]]:
    """The arcs, so that whatever comes before the first end of one is listed before it."""
    sequence, _ = _sorted(shop, [], np.zeros(len(shop.groups[0]), dtype=bool))
    place = np.argsort(sequence)
    return sorted(_arcs(shop), key=lambda arc: (int(place[arc[0]]), int(place[arc[1]])))


def _sorted(shop: Shop, waits: list[tuple[int, int]], early: BoolArray) -> tuple[IntArray, set[int]]:
    """[G] a topological order, `early` groups first where it is free, and the groups that wait for each other."""
    task, _ = shop.groups
    following: list[list[int]] = [[] for _ in range(len(task))]
    missing = [0] * len(task)
    for first, second in {*_arcs(shop), *waits}:
        following[first].append(second)
        missing[second] += 1
    rank = [(not early[group], int(task[group]), group) for group in range(len(task))]
    ready = [rank[group] for group in range(len(task)) if missing[group] == 0]
    heapq.heapify(ready)
    sequence: list[int] = []
    while ready:
        _, _, group = heapq.heappop(ready)
        sequence.append(group)
        for each in following[group]:
            missing[each] -= 1
            if missing[each] == 0:
                heapq.heappush(ready, rank[each])
    rest = set(range(len(task))) - set(sequence)
    return np.array([*sequence, *sorted(rest)], dtype=np.int64), rest


def _circle(shop: Shop, waits: list[tuple[int, int]], stuck: set[int]) -> list[int]:
    """The groups of a shortest circle whose waits are for lessons, in the order in which they wait."""
    reach = precedence(shop)
    task, _ = shop.groups
    pairs = [(first, group) for first, group in waits if first in stuck and group in stuck]
    follows: dict[int, list[int]] = {
        number: [other for other, (first, _) in enumerate(pairs) if reach[int(task[group]), first]]
        for number, (_, group) in enumerate(pairs)
    }
    best: list[int] = []
    for root in range(len(pairs)):
        came = {root: -1}
        queue = [root]
        for number in queue:
            if best and len(_way(came, number)) >= len(best):
                break
            if root in follows[number]:
                best = _way(came, number)
                break
            for other in follows[number]:
                if other not in came:
                    came[other] = number
                    queue.append(other)
    return [pairs[number][1] for number in best]


def _way(came: dict[int, int], number: int) -> list[int]:
    way = [number]
    while came[way[-1]] >= 0:
        way.append(came[way[-1]])
    return way[::-1]

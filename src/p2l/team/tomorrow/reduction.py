"""Today and tomorrow as facility location with weighted demands (thesis, theorem 3.4.1).

Today's part is the shop's own. To it are added, none of which is an approximation:

1. Each group of tomorrow's copies is a demand; its services cost as much as one attempt, times its expected number of
   copies (`TwoStage.groups`).
2. Today's lessons serve all of them.
3. A lesson to a robot in a scenario is a facility of its own, which costs its probability times `c_demo`, serves that
   scenario only, and the first copy of its type at 0.
4. A lesson tomorrow that would not pay even if no other were given is in no best plan; its services are left out.

A demand sees today's lessons and those of its own scenario, so no table of all pairs is made.
"""

from __future__ import annotations

import math

import numpy as np

from p2l.records import Array, BoolArray, IntArray
from p2l.team.cases import USELESS
from p2l.team.facility import Pairs, collect
from p2l.team.shop.reduction import Reduction
from p2l.team.tomorrow.record import TwoStage


def tomorrow_pairs(program: TwoStage, taught: IntArray | None = None, deadline: float = math.inf) -> Pairs:
    """The demands of tomorrow, with all facilities: lessons of today, of the first scenario, of the second and so on.

    Args:
        program: today and tomorrow.
        taught: [T, 2] lessons and robots that are given today, if that is decided: then they are part of what each
            demand can do without any other lesson, and today's facilities serve nothing.
        deadline: of `time.perf_counter`.

    Raises:
        TimeoutError: the deadline came first.
    """
    robots, width = len(program.today.robots), len(program.today.lessons) * len(program.today.robots)
    groups = program.groups
    waits = program.commit == "today"
    lesson, robot = np.divmod(np.arange(width), robots)
    attempts = _cost(program, robot, program.transfer[robot, lesson])
    without = np.minimum(program.c_hum, _cost(program, np.arange(robots), program.pretrained).min(axis=0))
    if taught is not None and len(taught):
        without = np.minimum(without, attempts[taught[:, 0] * robots + taught[:, 1]].min(axis=0))
    outside = without[groups.kind] * groups.weight
    today = np.where(np.isinf(program.today.c_demo[robot, lesson]) | (taught is not None), np.inf, 0.0)
    tomorrow = np.where(np.isinf(program.c_demo[robot, lesson]), np.inf, 0.0)
    is_own = (program.lesson[:, None] == lesson[None, :]) & (program.lesson >= 0)[:, None]

    def block(low: int, high: int) -> tuple[Array, BoolArray]:
        kind, weight = groups.kind[low:high], groups.weight[low:high]
        service = attempts[:, kind].T * weight[:, None]
        if not waits:
            cost = service + today
            return cost, cost < outside[low:high, None]
        own = groups.is_first[low:high, None] & is_own[kind]
        cost = np.concatenate([service + today, np.where(own, 0.0, service) + tomorrow], axis=1)
        return cost, cost < outside[low:high, None]

    scenarios = program.scenarios if waits else 0
    later = (program.probability[:scenarios, None] * program.c_demo[robot, lesson]).reshape(-1)
    opening = np.concatenate([np.full(width, np.inf), later])
    if not len(outside):
        return Pairs(opening, outside, np.zeros(1, dtype=np.int64), np.zeros(0, dtype=np.int32), np.zeros(0))
    narrow = collect(np.zeros(2 * width if waits else width), outside, block, deadline)
    place = narrow.facility.astype(np.int64)
    shift = np.where(place >= width, groups.scenario[narrow.rows()] * width, 0)
    pairs = narrow._replace(opening=opening, facility=(place + shift).astype(np.int32))
    saving = np.bincount(pairs.facility, pairs.outside[pairs.rows()] - pairs.cost, minlength=pairs.facilities)
    useless = saving * (1.0 + USELESS) <= opening
    useless[:width] = False  # today's, which have more to serve
    return _without(pairs, useless)


def reduce_two_stage(today: Reduction, tomorrow: Pairs) -> Reduction:
    """The instance of both: today's groups, then tomorrow's; `tomorrow_pairs` without lessons that are decided.

    A limit on lessons is on today's.
    """
    more = tomorrow.facilities - len(today.lesson)
    lesson, robot = (np.resize(each, tomorrow.facilities) for each in (today.lesson, today.robot))
    tomorrow = _without(tomorrow, np.pad(np.isinf(today.pairs.opening), (0, more)))
    pairs = Pairs(
        opening=np.concatenate([today.pairs.opening, tomorrow.opening[len(today.lesson) :]]),
        outside=np.concatenate([today.pairs.outside, tomorrow.outside]),
        start=np.concatenate([today.pairs.start, today.pairs.start[-1] + tomorrow.start[1:]]),
        facility=np.concatenate([today.pairs.facility, tomorrow.facility]),
        cost=np.concatenate([today.pairs.cost, tomorrow.cost]),
    )
    return Reduction(pairs, lesson, robot, np.pad(today.weights, ((0, 0), (0, more))))


def _cost(program: TwoStage, robot: IntArray, skill: Array) -> Array:
    """[K, J] expected cost of one attempt; a failure that cannot happen costs nothing."""
    risk = 1.0 - skill
    failure = np.zeros_like(risk)
    np.multiply(risk, program.c_fail[robot], out=failure, where=risk > 0.0)
    cost: Array = program.c_rob[robot] + failure
    return cost


def _without(pairs: Pairs, facilities: BoolArray) -> Pairs:
    """Without the services of some facilities [F]."""
    left = ~facilities[pairs.facility]
    start = np.concatenate([[0], np.cumsum(left)])[pairs.start]
    return pairs._replace(start=start, facility=pairs.facility[left], cost=pairs.cost[left])

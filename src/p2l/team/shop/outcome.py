"""What a plan of a shop costs, recomputed from the shop alone; it knows nothing of facilities, pairs or solvers.

Deviation from the thesis: 1. At equal expected cost a task goes to the person, whose result is certain, and an attempt
prefers pre-trained skills, then the lesson that comes first in `taught`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from p2l.errors import ShapeError
from p2l.records import Array, IntArray, freeze
from p2l.team.problem import Decision
from p2l.team.shop.record import Ruling, Shop, precedence


@dataclass(frozen=True)
class ShopOutcome:
    """Columns of `ShopPlan`, and `lessons_apart`: cost of lessons that complete none of today's tasks."""

    decision: IntArray
    robot: IntArray
    lesson: IntArray
    p_success: Array
    expected_cost: Array
    lessons_apart: float

    @property
    def total(self) -> float:
        """Expected cost of the whole plan, rounded once."""
        return math.fsum([*self.expected_cost.tolist(), self.lessons_apart])


def shop_outcome(shop: Shop, taught: IntArray, sequence: IntArray) -> ShopOutcome:
    """The best that can be done with given lessons in a given order of work.

    Args:
        shop: the day.
        taught: [T, 2] lessons and the robots that they are given to.
        sequence: [G] groups in the order of work. A lesson helps the groups that come after the one that it completes;
            one that completes none helps all.

    Raises:
        ShapeError: no such lesson or robot, one that is given twice; a sequence that is no permutation of the groups or
            breaks the order; a limit or a person's decision that is not kept.
    """
    task, size = shop.groups
    steps = _sequence(shop, sequence)
    lesson, robot = _taught(shop, taught)
    place = np.empty(len(task), dtype=np.int64)
    place[steps] = np.arange(len(task))
    own, price = shop.completes[lesson], shop.c_demo[robot, lesson]
    is_taught = np.zeros(len(task), dtype=bool)
    is_taught[own[own >= 0]] = True
    if (missing := (shop.choice == Ruling.LEARN) & ~is_taught[: shop.n]).any():
        raise ShapeError(f"plan: task '{shop.tasks[int(missing.argmax())]}' is to be taught, and is not")

    # Every way to do a copy, one row each: the person, the pre-trained skills of each robot, each lesson.
    comes_in_time = (own < 0)[:, None] | (place[np.maximum(own, 0)][:, None] < place[None, :])
    skills = np.concatenate([shop.pretrained, shop.transfer[robot, lesson]])[:, task]
    robots = np.concatenate([np.arange(len(shop.robots)), robot])
    attempts = attempt_cost(shop, robots[:, None], task[None, :], skills)
    attempts[len(shop.robots) :][~comes_in_time] = np.inf
    attempts[:, shop.choice[task] == Ruling.DELEGATE] = np.inf
    person = np.where(shop.choice[task] == Ruling.ACT, np.inf, shop.c_hum[task])
    ways = np.concatenate([person[None], attempts])
    way = ways.argmin(axis=0)
    groups = np.arange(len(task))
    lessons = np.concatenate([np.full(1 + len(shop.robots), -1), lesson])
    first = np.full(len(task), -1)  # of the lessons that complete a group
    np.put(first, own[::-1][own[::-1] >= 0], np.arange(len(own))[::-1][own[::-1] >= 0])
    demonstration = np.bincount(own[own >= 0], price[own >= 0], minlength=len(task))
    return ShopOutcome(
        decision=np.where(is_taught, Decision.LEARN, np.where(way == 0, Decision.DELEGATE, Decision.ACT)),
        robot=np.where(is_taught, _at(robot, first), np.where(way == 0, -1, _at(robots, way - 1))),
        lesson=np.where(is_taught, _at(lesson, first), lessons[way]),
        p_success=np.where(is_taught | (way == 0), 1.0, _at(skills, way - 1, groups)),
        expected_cost=np.where(is_taught, demonstration, ways[way, groups] * size),
        lessons_apart=math.fsum(price[own < 0].tolist()),
    )


def _at(values: npt.NDArray[Any], *index: IntArray) -> npt.NDArray[Any]:
    """Entries of an array, its last one where the index is -1 (which a caller does not look at)."""
    return values[index] if values.size else np.zeros(len(index[0]), dtype=values.dtype)


def attempt_cost(shop: Shop, robot: IntArray, task: IntArray, probability: Array) -> Array:
    """Expected cost c_rob + (1 - ρ) c_fail of one attempt; a failure that cannot happen costs nothing."""
    risk, c_fail = 1.0 - probability, shop.c_fail[robot, task]
    failure = np.where(risk > 0.0, np.where(risk > 0.0, risk, 1.0) * np.where(risk > 0.0, c_fail, 0.0), 0.0)
    return np.asarray(shop.c_rob[robot, task] + failure)


def _taught(shop: Shop, taught: IntArray) -> tuple[IntArray, IntArray]:
    """Lessons [T] and robots [T]."""
    pairs = freeze("taught", np.reshape(taught, (-1, 2)), ("T", 2), {}, np.int64, low=0)
    if len(np.unique(pairs, axis=0)) < len(pairs):
        raise ShapeError("plan: a lesson is given to a robot twice")
    if (pairs >= (len(shop.lessons), len(shop.robots))).any():
        raise ShapeError("plan: it gives a lesson, or has a robot, that there is not")
    lesson, robot = pairs[:, 0], pairs[:, 1]
    own = shop.completes[lesson]
    ruled_out = (own >= 0) & ~np.isin(shop.choice[own], (Ruling.FREE, Ruling.LEARN))
    if ruled_out.any():
        raise ShapeError(f"plan: task '{shop.tasks[own[ruled_out][0]]}' is taught, though that is ruled out")
    time = math.fsum(shop.c_demo[robot, lesson].tolist())
    if len(pairs) > shop.max_lessons or time > shop.max_teaching * (1.0 + 1e-12):
        raise ShapeError(f"plan: {len(pairs)} lessons that take {time:g} are more than its limits allow")
    return lesson, robot


def _sequence(shop: Shop, sequence: IntArray) -> IntArray:
    task, _ = shop.groups
    steps: IntArray = freeze("sequence", sequence, ("G",), {"G": len(task)}, np.int64)
    if not np.array_equal(np.sort(steps), np.arange(len(task))):
        raise ShapeError("sequence: is not a permutation of the groups of copies; list every group once")
    place = np.empty(len(task), dtype=np.int64)
    place[steps] = np.arange(len(task))
    first, last = place[: shop.n].copy(), place[: shop.n].copy()
    np.maximum.at(last, task, place)
    np.minimum.at(first, task, place)
    wrong = precedence(shop) & ~(last[:, None] < first[None, :])
    if wrong.any():
        earlier, later = (shop.tasks[each] for each in np.argwhere(wrong)[0].tolist())
        raise ShapeError(f"sequence: '{later}' comes before '{earlier}', against the order of work")
    if (place[shop.n :] < place[: shop.n][task[shop.n :]]).any():
        raise ShapeError("sequence: the other copies of a task come before its first")
    return steps

"""What has happened so far, and the shop that is left: done copies gone, lessons that were given among the skills.

What is left is a `Shop` as any other, so that whatever holds for plans of shops holds for the rest of a day:

1. A failed attempt costs c_rob + c_fail, and the copy is done: the person does it, which c_fail pays (section 3.3.1).
2. A lesson that was taught to a robot is part of its `pretrained`: the best of its skills, by what is expected of each
   after the outcomes (`skills`). It cannot be given to that robot again.
3. A copy of a task whose first copy was taught is not taught. If the demonstration did not teach, the next copy may be.
4. Right after a demonstration further robots may be taught by it; it completes no further copy.
5. Limits are what is left of them; a lesson that did not teach counts, too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from p2l.records import Array, IntArray, freeze
from p2l.team.shop.record import Ruling, Shop


@dataclass(frozen=True)
class Learnt:
    """A lesson that was taught to a robot, and what came of it.

    Attributes:
        lesson: its number.
        robot: whose skill it is.
        successes: [n] of its attempts.
        failures: [n] of its attempts.
        expected: [n] success probability that is expected now.
    """

    lesson: int
    robot: int
    successes: Array
    failures: Array
    expected: Array

    def __post_init__(self) -> None:
        for name in ("successes", "failures", "expected"):
            object.__setattr__(self, name, freeze(name, getattr(self, name), ("n",), {}, low=0.0))


@dataclass(frozen=True)
class Standing:
    """What the events of a day come to.

    Attributes:
        done: [n] copies.
        successes: [R, n] of attempts with pre-trained skills.
        failures: [R, n] of attempts with pre-trained skills.
        pretrained: [R, n] success probability that is expected of them now.
        learnt: lessons that were taught, in order.
        demonstrations: how many were given, with those that did not teach.
        teaching: sum of what they cost.
        shown: lesson whose demonstration was the last event; -1 if that was something else.
        spent: cost of all events.
    """

    done: IntArray
    successes: Array
    failures: Array
    pretrained: Array
    learnt: tuple[Learnt, ...] = ()
    demonstrations: int = 0
    teaching: float = 0.0
    shown: int = -1
    spent: float = 0.0

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        object.__setattr__(self, "done", freeze("done", self.done, ("n",), sizes, np.int64, low=0))
        for name in ("successes", "failures", "pretrained"):
            object.__setattr__(self, name, freeze(name, getattr(self, name), ("R", "n"), sizes, low=0.0))

    @classmethod
    def morning(cls, shop: Shop) -> Standing:
        """Before anything has happened."""
        nothing = np.zeros(shop.pretrained.shape)
        return cls(np.zeros(shop.n, dtype=np.int64), nothing, nothing, shop.pretrained)

    def has(self, lesson: int, robot: int) -> bool:
        """Whether a robot was taught a lesson."""
        return any((each.lesson, each.robot) == (lesson, robot) for each in self.learnt)

    def place(self, lesson: int, robot: int) -> int:
        """Place in `learnt` of a lesson that a robot was taught."""
        [place] = [k for k, each in enumerate(self.learnt) if (each.lesson, each.robot) == (lesson, robot)]
        return place


@dataclass(frozen=True)
class Rest:
    """What is left of a day.

    Attributes:
        shop: m tasks and k lessons of it.
        task: [m] their numbers in the morning's shop.
        lesson: [k] their numbers in the morning's shop.
        source: [R, m] lesson behind `shop.pretrained`, a number of the morning's shop; -1 for pre-trained skills.
    """

    shop: Shop
    task: IntArray
    lesson: IntArray
    source: IntArray

    @property
    def place_of_task(self) -> dict[int, int]:
        """Number in the morning's shop → number here."""
        return {each: place for place, each in enumerate(self.task.tolist())}

    @property
    def place_of_lesson(self) -> dict[int, int]:
        """Number in the morning's shop → number here."""
        return {each: place for place, each in enumerate(self.lesson.tolist())}


def remaining_shop(shop: Shop, standing: Standing) -> Rest | None:
    """The shop that is left, None if all copies are done; what it changes is told above."""
    task = np.flatnonzero(standing.done < shop.count)
    if not len(task):
        return None
    skill, source = _skills(standing)
    own = shop.completes
    was_taught = np.zeros(shop.n, dtype=bool)
    c_demo = shop.c_demo.copy()
    for each in standing.learnt:
        c_demo[each.robot, each.lesson] = np.inf
        if own[each.lesson] >= 0:
            was_taught[own[each.lesson]] = True
    is_apart = own < 0
    closed = ~is_apart & was_taught[np.maximum(own, 0)]
    if standing.shown >= 0:
        closed[standing.shown] = False
        is_apart = is_apart.copy()
        is_apart[standing.shown] = True
    c_demo[:, closed] = np.inf
    place = np.full(shop.n, -1)
    place[task] = np.arange(len(task))
    lesson = np.flatnonzero(is_apart & np.isfinite(c_demo).any(axis=0) | ~is_apart & (place[np.maximum(own, 0)] >= 0))
    choice = shop.choice.copy()
    choice[was_taught & np.isin(choice, (Ruling.FREE, Ruling.LEARN))] = Ruling.NOT_LEARN
    arcs = place[shop.arcs]
    rest = replace(
        shop,
        tasks=tuple(shop.tasks[each] for each in task),
        lessons=tuple(shop.lessons[each] for each in lesson),
        completes=np.where(is_apart[lesson], -1, place[np.maximum(own[lesson], 0)]),
        count=(shop.count - standing.done)[task],
        c_hum=shop.c_hum[task],
        c_rob=shop.c_rob[:, task],
        c_fail=shop.c_fail[:, task],
        pretrained=skill[:, task],
        c_demo=c_demo[:, lesson],
        transfer=shop.transfer[:, lesson][:, :, task],
        choice=choice[task],
        before=arcs[(arcs >= 0).all(axis=1)].reshape(-1, 2),
        max_lessons=max(0.0, shop.max_lessons - standing.demonstrations),
        max_teaching=max(0.0, shop.max_teaching - standing.teaching),
    )
    return Rest(rest, task, lesson, source[:, task])


def _skills(standing: Standing) -> tuple[Array, IntArray]:
    """[R, n] the best that each robot can do now, and [R, n] by which lesson, -1 for pre-trained skills."""
    best = standing.pretrained.copy()
    source = np.full(best.shape, -1)
    for each in standing.learnt:
        better = each.expected > best[each.robot]
        best[each.robot, better] = each.expected[better]
        source[each.robot, better] = each.lesson
    return best, source

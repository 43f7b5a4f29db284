"""A day in a shop: what a person has beyond a square table (thesis, sections 3.2.1 and 6.2.1), and the plan for it.

Axis letters of this room: n tasks, R robots, L lessons, G groups of equal copies, K limits, P arcs of a
partial order.

Deviations from the thesis, each of which is the thesis's problem where it is not used:
    1. A task may come `count` times; the first copy may be taught, the others are attempts (ρ_ii counts) or the
       person's.
    2. Lessons need not be among today's tasks: such a lesson can come first, and completes none of them.
    3. A lesson is a lesson to one robot; a taught task may be taught to several, each for the cost of a demonstration.
    4. Work is in the given order, in any order, or in any order that keeps a partial one (section 6.2.1).
    5. A decision can be forced or forbidden, and the number of lessons and the time they take can be limited.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

import numpy as np

from p2l.errors import ShapeError
from p2l.records import Array, BoolArray, IntArray, freeze
from p2l.team.costs import freeze_cost
from p2l.team.problem import Certificate, Problem, Status, freeze_columns

ShopOrder = Literal["fixed", "any", "partial"]
SHOP_ORDERS: tuple[str, ...] = ("fixed", "any", "partial")


class Ruling(IntEnum):
    """What a person has decided already for a task: nothing, what happens to it, or that it is not taught."""

    FREE = -1
    ACT = 0
    DELEGATE = 1
    LEARN = 2
    NOT_LEARN = 3


@dataclass(frozen=True)
class Shop:
    """Today's tasks, robots, lessons and limits; all costs in one unit, chosen by the user.

    Attributes:
        tasks: n distinct names, in work order.
        robots: R distinct names.
        lessons: L distinct names.
        completes: [L] task that the lesson's demonstration completes (one copy of it), -1 for none of today's.
        count: [n] copies of each task, at least 1.
        c_hum: [n] cost of handing one copy to the person; infinite where the person cannot.
        c_rob: [R, n] cost of an attempt; infinite where the robot cannot.
        c_fail: [R, n] cost of a failed attempt on top of the attempt, the person's doing the task after it included.
        pretrained: [R, n] success probability of the skills that a robot has.
        c_demo: [R, L] cost of teaching a lesson to a robot; infinite where it cannot be taught.
        transfer: [R, L, n] success probability on a task after a lesson to the robot that attempts it. A lesson's own
            task uses it for the copies after the first.
        choice: [n] a `Ruling`.
        order: "fixed", "any", or "partial": any that keeps `before`.
        before: [P, 2] tasks of which the first is done before the second, all copies of it.
        max_lessons: lessons, at most, a whole number; infinite for no limit.
        max_teaching: sum of their `c_demo`, at most; infinite for no limit.

    Raises:
        ShapeError: a wrong shape, a repeated name, a number out of range, a partial order with a circle.

    Example:
        Two pegs and a lid; a lesson on the pegs' task is of no use for the lid.

        >>> import numpy as np
        >>> from p2l import Shop
        >>> one = np.ones((1, 2))
        >>> day = Shop(
        ...     tasks=("peg", "lid"), robots=("arm",), lessons=("peg", "lid"), completes=[0, 1], count=[2, 1],
        ...     c_hum=[100.0, 100.0], c_rob=10 * one, c_fail=100 * one, pretrained=0 * one, c_demo=[[120.0, np.inf]],
        ...     transfer=[[[0.9, 0.0], [0.0, 0.9]]], choice=[-1, -1],
        ... )
        >>> day.n, [size.tolist() for size in day.groups]
        (2, [[0, 1, 0], [1, 1, 1]])
    """

    tasks: tuple[str, ...]
    robots: tuple[str, ...]
    lessons: tuple[str, ...]
    completes: IntArray
    count: IntArray
    c_hum: Array
    c_rob: Array
    c_fail: Array
    pretrained: Array
    c_demo: Array
    transfer: Array
    choice: IntArray
    order: ShopOrder = "fixed"
    before: IntArray | None = None
    max_lessons: float = math.inf
    max_teaching: float = math.inf

    def __post_init__(self) -> None:
        put = object.__setattr__
        for name in ("tasks", "robots", "lessons"):
            names = tuple(getattr(self, name))
            if len(set(names)) < len(names):
                twice = next(each for each in names if names.count(each) > 1)
                raise ShapeError(f"{name}: '{twice}' appears more than once; give each its own name")
            put(self, name, names)
        if not self.tasks or not self.robots:
            raise ShapeError("tasks: a shop needs at least one task and one robot")
        if self.order not in SHOP_ORDERS:
            raise ShapeError(f"order: '{self.order}' is unknown; use one of {list(SHOP_ORDERS)}")
        sizes = {"n": len(self.tasks), "R": len(self.robots), "L": len(self.lessons)}
        last = sizes["n"] - 1
        put(self, "completes", freeze("completes", self.completes, ("L",), sizes, np.int64, low=-1, high=last))
        own = self.completes[self.completes >= 0]
        if len(np.unique(own)) < len(own):
            raise ShapeError("completes: two lessons complete one task; give it one of them")
        put(self, "count", freeze("count", self.count, ("n",), sizes, np.int64, low=1, high=1_000_000))
        put(self, "choice", freeze("choice", self.choice, ("n",), sizes, np.int64, low=-1, high=3))
        for name, shape in (("c_hum", ("n",)), ("c_rob", ("R", "n")), ("c_fail", ("R", "n")), ("c_demo", ("R", "L"))):
            put(self, name, freeze_cost(name, getattr(self, name), shape, sizes))
        put(self, "pretrained", freeze("pretrained", self.pretrained, ("R", "n"), sizes, low=0.0, high=1.0))
        put(self, "transfer", freeze("transfer", self.transfer, ("R", "L", "n"), sizes, low=0.0, high=1.0))
        before = np.zeros((0, 2), dtype=np.int64) if self.before is None else self.before
        put(self, "before", freeze("before", before, ("P", 2), sizes, np.int64, low=0, high=sizes["n"] - 1))
        for name in ("max_lessons", "max_teaching"):
            if not float(getattr(self, name)) >= 0.0:
                raise ShapeError(f"{name}: {getattr(self, name)} given; expected a number of at least 0")
        if math.isfinite(self.max_lessons) and self.max_lessons != math.floor(self.max_lessons):
            raise ShapeError(f"max_lessons: {self.max_lessons} given; expected a whole number")
        if self.order != "partial" and len(self.arcs):
            raise ShapeError(f"before: given with order={self.order}; a partial order needs order=partial")
        if self.order == "partial":
            precedence(self)  # refuses a circle

    @property
    def n(self) -> int:
        """How many tasks there are, each counted once."""
        return len(self.tasks)

    @property
    def arcs(self) -> IntArray:
        """[P, 2] arcs of the partial order."""
        assert self.before is not None
        return self.before

    @property
    def is_limited(self) -> bool:
        """Whether the number of lessons or the cost of them is limited."""
        return math.isfinite(self.max_lessons) or math.isfinite(self.max_teaching)

    @property
    def groups(self) -> tuple[IntArray, IntArray]:
        """[G] task and [G] size of the groups of copies that are treated alike.

        First the first copy of every task, then, for tasks that come more than once, all others together.
        """
        more = np.flatnonzero(self.count > 1)
        task = np.concatenate([np.arange(self.n), more])
        return task, np.concatenate([np.ones(self.n, dtype=np.int64), self.count[more] - 1])

    @classmethod
    def of_problem(cls, problem: Problem) -> Shop:
        """The shop that is a thesis's problem: one robot, each task once, a lesson on every task."""
        return cls(
            tasks=problem.tasks,
            robots=("robot",),
            lessons=problem.tasks,
            completes=np.arange(problem.n),
            count=np.ones(problem.n, dtype=np.int64),
            c_hum=problem.c_hum,
            c_rob=problem.c_rob[None],
            c_fail=problem.c_fail[None],
            pretrained=problem.pretrained[None],
            c_demo=problem.c_demo[None],
            transfer=problem.transfer[None],
            choice=np.full(problem.n, Ruling.FREE),
            order=problem.order,
        )

    def problem(self) -> Problem | None:
        """The thesis's problem that this shop is, or None if it is more than that."""
        plain = len(self.robots) == 1 and len(self.lessons) == self.n and self.order != "partial"
        plain = plain and bool((self.completes == np.arange(self.n)).all() and (self.count == 1).all())
        plain = plain and bool((self.choice == Ruling.FREE).all())
        if not plain or self.is_limited:
            return None
        order: Literal["fixed", "any"] = "any" if self.order == "any" else "fixed"
        return Problem(
            self.tasks, self.c_rob[0], self.c_hum, self.c_fail[0], self.c_demo[0], self.pretrained[0],
            self.transfer[0], order,
        )  # fmt: skip


@dataclass(frozen=True)
class ShopCertificate:
    """Why a lower bound of a shop holds.

    Where the order is partial, an optimal choice of lessons for tasks can be a circle: cases follow, in each of which
    one pair of the circle is left out. A case without cases below it has a certificate of its own.

    Attributes:
        parent: [C] of a case; -1 of the root, which is case 0; cases come after their parents.
        lesson: [C] lesson of the pair that is left out from a case on; -1 of the root.
        group: [C] group of copies of that pair; -1 of the root.
        leaf: C certificates, None where cases follow.
    """

    parent: IntArray
    lesson: IntArray
    group: IntArray
    leaf: tuple[Certificate | None, ...]

    def __post_init__(self) -> None:
        sizes = {"C": len(self.leaf)}
        for name in ("parent", "lesson", "group"):
            value = freeze(name, getattr(self, name), ("C",), sizes, np.int64, low=-1)
            object.__setattr__(self, name, value)


@dataclass(frozen=True)
class ShopPlan:
    """What is done with every group of copies, in order of work.

    Attributes:
        planner: what made it.
        status: as in `Plan`.
        taught: [T, 2] lessons and the robots that they are given to.
        sequence: [G] groups in the order of work; a group that is taught completes its first copy there.
        decision: [G] a `Decision`.
        robot: [G] robot of an attempt or a demonstration, -1 if the person does it.
        lesson: [G] lesson that an attempt uses, or that a demonstration gives; -1 for pre-trained skills or none.
        p_success: [G] of each copy.
        expected_cost: [G] of all copies together. A lesson that completes none of today's tasks is in no group.
        objective: expected cost of all groups, and of lessons that complete none of them.
        lower_bound: no plan costs less, by the certificate.
        gap: as in `Plan`.
        seconds: wall time.
        certificate: the proof of the bound.
    """

    planner: str
    status: Status
    taught: IntArray
    sequence: IntArray
    decision: IntArray
    robot: IntArray
    lesson: IntArray
    p_success: Array
    expected_cost: Array
    objective: float
    lower_bound: float
    gap: float
    seconds: float
    certificate: ShopCertificate | None = None

    def __post_init__(self) -> None:
        taught = freeze("taught", np.reshape(self.taught, (-1, 2)), ("T", 2), {}, np.int64)
        object.__setattr__(self, "taught", taught)
        freeze_columns(self, ("G",), ("sequence", "decision", "robot", "lesson"), ("p_success", "expected_cost"))


def precedence(shop: Shop) -> BoolArray:
    """[n, n] whether a task (row) has to be done before another (column).

    Raises:
        ShapeError: the partial order has a circle; the message names its tasks.
    """
    if shop.order == "fixed":
        return np.triu(np.ones((shop.n, shop.n), dtype=bool), 1)
    reach = np.zeros((shop.n, shop.n), dtype=bool)
    following: list[list[int]] = [[] for _ in range(shop.n)]
    for first, second in shop.arcs.tolist():
        following[first].append(second)
    state = [0] * shop.n  # 1 on the way, 2 done
    for root in range(shop.n):
        stack = [(root, iter(following[root]))] if state[root] == 0 else []
        state[root] = max(state[root], 1)
        while stack:
            task, rest = stack[-1]
            after = next(rest, None)
            if after is None:
                stack.pop()
                state[task] = 2
                for each in following[task]:
                    reach[task] |= reach[each]
                    reach[task, each] = True
            elif state[after] == 1:
                way = [each for each, _ in stack]
                names = " before ".join(shop.tasks[each] for each in [*way[way.index(after) :], after])
                raise ShapeError(f"before: goes in a circle: {names}; remove one of these lines")
            elif state[after] == 0:
                state[after] = 1
                stack.append((after, iter(following[after])))
    return reach

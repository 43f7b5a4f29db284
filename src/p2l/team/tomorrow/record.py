"""Today's orders and those that may come tomorrow (thesis, section 6.2.1), and the plan for both.

Axis letters of this room: those of `p2l.team.shop` for today (n tasks, R robots, L lessons, G groups of copies), and J
types of tasks that may come tomorrow, S scenarios of how many of each do, D groups of tomorrow's copies.

What is decided today holds in every scenario; what is decided tomorrow may depend on the scenario. The expected cost of
both is the objective: a stochastic program in two stages. Tomorrow's work is in any order.

Deviations from the thesis, which only says that tasks could be sampled from their distribution:
    1. A lesson that is given today helps tomorrow, too; its own type then comes as attempts (ρ_ii counts), or the
       person does it.
    2. A lesson on a type that is none of today's tasks can be given today; it then completes nothing.
    3. Tomorrow, once its orders are known, lessons can be given as well (`commit="today"`), each for its own scenario.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np

from p2l.errors import ShapeError
from p2l.records import Array, BoolArray, IntArray, freeze
from p2l.team.costs import freeze_cost
from p2l.team.problem import Status, relative_gap
from p2l.team.shop.record import Shop, ShopCertificate, ShopPlan

Commit = Literal["today", "all"]
COMMITS: tuple[str, ...] = get_args(Commit)
_SUM = 1e-9  # by how much probabilities may miss one


class Groups(NamedTuple):
    """Groups of tomorrow's copies that are treated alike.

    Attributes:
        scenario: [D] in which they come; -1 where all scenarios are together.
        kind: [D] type.
        weight: [D] expected number of copies: probability of the scenario times copies in it.
        is_first: [D] whether a lesson on the type in that scenario completes them.
    """

    scenario: IntArray
    kind: IntArray
    weight: Array
    is_first: BoolArray


@dataclass(frozen=True)
class TwoStage:
    """Today, what may come tomorrow, and what can be decided then; costs in the unit of today's.

    Attributes:
        today: today's orders. Its lessons are all that can be given, on tomorrow's types as well.
        types: J distinct names of tasks that may come tomorrow.
        lesson: [J] lesson of `today` that teaches the type, -1 for none: given tomorrow it completes one copy.
        c_hum: [J] as in `Shop`, tomorrow.
        c_rob: [R, J] as in `Shop`, tomorrow.
        c_fail: [R, J] as in `Shop`, tomorrow.
        pretrained: [R, J] as in `Shop`, tomorrow.
        c_demo: [R, L] cost of teaching a lesson to a robot tomorrow; infinite where it cannot be taught then.
        transfer: [R, L, J] success probability on a type after a lesson to the robot that attempts it.
        counts: [S, J] copies of each type in each scenario. They need not be whole: a scenario can be a mean, and a
            lesson then completes at most what there is of one copy.
        probability: [S] of each scenario, above 0; they sum to one.
        commit: "today": tomorrow's lessons can wait until its orders are known. "all": there are none tomorrow.

    Raises:
        ShapeError: a wrong shape, a repeated name, a number out of range.

    Example:
        A peg today; tomorrow a lid or nothing.

        >>> import numpy as np
        >>> from p2l import Shop
        >>> from p2l.team.tomorrow import TwoStage
        >>> one, two = np.ones((1, 1)), np.ones((1, 2))
        >>> shop = Shop(
        ...     tasks=("peg",), robots=("arm",), lessons=("peg", "lid"), completes=[0, -1], count=[1], c_hum=[100.0],
        ...     c_rob=10 * one, c_fail=100 * one, pretrained=0 * one, c_demo=120 * two, transfer=[[[0.9], [0.0]]],
        ...     choice=[-1],
        ... )
        >>> both = TwoStage(
        ...     today=shop, types=("lid",), lesson=[1], c_hum=[100.0], c_rob=10 * one, c_fail=100 * one,
        ...     pretrained=0 * one, c_demo=120 * two, transfer=[[[0.5], [0.9]]], counts=[[1], [0]],
        ...     probability=[0.5, 0.5],
        ... )
        >>> both.groups.weight.tolist(), both.commit
        ([0.5], 'today')
    """

    today: Shop
    types: tuple[str, ...]
    lesson: IntArray
    c_hum: Array
    c_rob: Array
    c_fail: Array
    pretrained: Array
    c_demo: Array
    transfer: Array
    counts: Array
    probability: Array
    commit: Commit = "today"

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "types", tuple(self.types))
        if len(set(self.types)) < len(self.types):
            twice = next(each for each in self.types if self.types.count(each) > 1)
            raise ShapeError(f"types: '{twice}' appears more than once; give each its own name")
        if self.commit not in COMMITS:
            raise ShapeError(f"commit: '{self.commit}' is unknown; use one of {list(COMMITS)}")
        sizes = {"J": len(self.types), "R": len(self.today.robots), "L": len(self.today.lessons)}
        lesson = freeze("lesson", self.lesson, ("J",), sizes, np.int64, low=-1, high=len(self.today.lessons) - 1)
        put(self, "lesson", lesson)
        if len(np.unique(lesson[lesson >= 0])) < int((lesson >= 0).sum()):
            raise ShapeError("lesson: two types have one lesson; give each its own")
        for name, shape in (("c_hum", ("J",)), ("c_rob", ("R", "J")), ("c_fail", ("R", "J")), ("c_demo", ("R", "L"))):
            put(self, name, freeze_cost(name, getattr(self, name), shape, sizes))
        put(self, "pretrained", freeze("pretrained", self.pretrained, ("R", "J"), sizes, low=0.0, high=1.0))
        put(self, "transfer", freeze("transfer", self.transfer, ("R", "L", "J"), sizes, low=0.0, high=1.0))
        put(self, "counts", freeze("counts", self.counts, ("S", "J"), sizes, low=0.0, high=1e6))
        put(self, "probability", freeze("probability", self.probability, ("S",), sizes, low=0.0, high=1.0))
        if not (self.probability > 0.0).all():
            raise ShapeError("probability: a scenario has none; leave it out")
        if abs(total := math.fsum(self.probability.tolist()) - 1.0) > _SUM:
            raise ShapeError(f"probability: the scenarios' sum to {1.0 + total:.12g}; expected 1")

    @property
    def scenarios(self) -> int:
        """S."""
        return len(self.probability)

    @property
    def groups(self) -> Groups:
        """Groups of tomorrow's copies, those of a scenario together.

        Where no lesson is given tomorrow, nothing tells one scenario from another: all copies of a type in all of them
        are one group, whose weight is their expected number. The cost of a plan is linear in it, so that is exact.
        Otherwise the first copy of a type, which a lesson may complete, is apart from the others.
        """
        if self.commit == "all":
            expected = self.probability @ self.counts
            kind = np.flatnonzero(expected > 0.0)
            none = np.full(len(kind), -1, dtype=np.int64)
            return Groups(none, kind, expected[kind], np.zeros(len(kind), dtype=bool))
        can_teach = np.isfinite(self.c_demo).any(axis=0) if self.c_demo.size else np.zeros(0, dtype=bool)
        taught = np.zeros(len(self.types), dtype=bool)
        taught[self.lesson >= 0] = can_teach[self.lesson[self.lesson >= 0]]
        first = np.where(taught, np.minimum(self.counts, 1.0), 0.0)
        copies = np.stack([first, self.counts - first], axis=2)
        scenario, kind, part = np.nonzero(copies > 0.0)
        weight = self.probability[scenario] * copies[scenario, kind, part]
        return Groups(scenario, kind, weight, part == 0)

    def teachable(self) -> IntArray:
        """[K, 2] lessons and robots that it is possible to teach tomorrow."""
        if self.commit == "all":
            return np.zeros((0, 2), dtype=np.int64)
        robot, lesson = np.nonzero(np.isfinite(self.c_demo))
        return np.stack([lesson, robot], axis=1)


@dataclass(frozen=True)
class TwoStagePlan:
    """What is done today, and what tomorrow in each scenario.

    Attributes:
        today: of today's groups. Its objective is today's share; of today alone nothing is proven (its lower bound
            is 0, its status "heuristic").
        later: [K, 3] scenario, lesson and robot of what is taught tomorrow.
        tomorrow: [S] expected cost of each scenario, its lessons included.
        objective: today's cost and the expected cost of tomorrow.
        lower_bound: no plan costs less in expectation, by the certificate.
        gap: as in `Plan`.
        status: as in `Plan`.
        seconds: wall time.
        certificate: the proof of the bound; its groups are today's, then `TwoStage.groups`.
    """

    today: ShopPlan
    later: IntArray
    tomorrow: Array
    objective: float
    lower_bound: float
    gap: float
    status: Status
    seconds: float
    certificate: ShopCertificate | None = None

    def __post_init__(self) -> None:
        put = object.__setattr__
        later = np.reshape(np.asarray(self.later), (-1, 3)) if np.size(self.later) else np.zeros((0, 3), np.int64)
        put(self, "later", freeze("later", later, ("K", 3), {}, np.int64, low=0))
        put(self, "tomorrow", freeze("tomorrow", self.tomorrow, ("S",), {}, finite=False))

    @property
    def taught(self) -> IntArray:
        """[T, 2] lessons that are given today, and the robots that they are given to."""
        return self.today.taught

    def shares(self, program: TwoStage) -> Iterator[tuple[int, int, float]]:
        """Lesson, robot and share of the scenarios of each lesson that waits, the most probable first."""
        names, place = np.unique(self.later[:, 1:], axis=0, return_inverse=True)
        share = np.bincount(place.reshape(-1), program.probability[self.later[:, 0]], minlength=len(names))
        for each in np.argsort(-share, kind="stable").tolist():
            yield int(names[each, 0]), int(names[each, 1]), float(share[each])


def proven_gap(cost: float, bound: float) -> tuple[float, float]:
    """The bound, no higher than the cost, and the relative gap."""
    low = min(cost, bound)
    return low, relative_gap(cost, low)

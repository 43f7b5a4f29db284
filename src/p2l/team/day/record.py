"""A day: what was planned in the morning, what has happened, and the plan for the rest.

Axis letters as in `p2l.team.shop`: n tasks, R robots, L lessons. Numbers of tasks, robots and lessons are those of the
morning's shop.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from p2l.errors import InputError
from p2l.records import Array, freeze
from p2l.team.day.remaining import Rest, Standing
from p2l.team.day.skills import SkillPrior
from p2l.team.problem import Decision
from p2l.team.shop.record import Shop, ShopPlan


class EventOutcome(StrEnum):
    """How a step ended."""

    SUCCESS = "success"
    FAILURE = "failure"
    DONE = "done"
    NOT_TAUGHT = "not taught"


ALLOWED: Mapping[Decision, tuple[EventOutcome, ...]] = {
    Decision.ACT: (EventOutcome.SUCCESS, EventOutcome.FAILURE),
    Decision.DELEGATE: (EventOutcome.DONE,),
    Decision.LEARN: (EventOutcome.DONE, EventOutcome.NOT_TAUGHT),
}


class EventError(InputError):
    """An event that cannot have happened on this day; `field` is the column that is wrong."""

    def __init__(self, field_name: str, problem: str) -> None:
        super().__init__(f"{field_name}: {problem}")
        self.field, self.problem = field_name, problem


@dataclass(frozen=True)
class Event:
    """What happened to one copy of a task, or a lesson that completes none.

    Attributes:
        task: its number; -1 for a lesson on none of today's tasks.
        copy: 1 for the first copy that is done, and so on; 0 without a task.
        decision: what happened to it.
        robot: that attempted or was taught; -1 for the person.
        lesson: that an attempt used or that was given; -1 for pre-trained skills and the person.
        outcome: how it ended.
        note: of the person's own.
    """

    task: int
    copy: int
    decision: Decision
    robot: int
    lesson: int
    outcome: EventOutcome
    note: str = ""


@dataclass(frozen=True)
class Step:
    """A step that the plan of the rest has, with the numbers of the morning's shop; as in `Event`."""

    task: int
    copy: int
    decision: Decision
    robot: int
    lesson: int
    p_success: float
    expected_cost: float


@dataclass(frozen=True)
class Day:
    """A day so far.

    Attributes:
        shop: as it was planned in the morning.
        trials: [R, L, n] attempts behind each transfer probability; 0 where it is a prediction alone.
        setting: how fast outcomes change what is believed.
        time_limit_s: wall seconds of each plan.
        events: what has happened, in order.
        standing: what that comes to.
        rest: what is left; None if nothing is.
        plan: of the rest; None if nothing is left.
    """

    shop: Shop
    trials: Array
    setting: SkillPrior
    time_limit_s: float
    events: tuple[Event, ...]
    standing: Standing
    rest: Rest | None
    plan: ShopPlan | None

    def __post_init__(self) -> None:
        sizes = {"R": len(self.shop.robots), "L": len(self.shop.lessons), "n": self.shop.n}
        object.__setattr__(self, "trials", freeze("trials", self.trials, ("R", "L", "n"), sizes, low=0.0))

    @property
    def spent(self) -> float:
        """Cost of what has happened."""
        return self.standing.spent

    @property
    def left(self) -> float:
        """Expected cost of the rest."""
        return 0.0 if self.plan is None else self.plan.objective

    @property
    def expected_total(self) -> float:
        """Cost of what has happened, and expected cost of the rest."""
        return self.spent + self.left

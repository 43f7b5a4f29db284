"""The rows of a plan of a shop as a person reads them: what is done, step by step, in order of work."""

from __future__ import annotations

from dataclasses import dataclass

from p2l.team.problem import Decision
from p2l.team.shop.record import Shop, ShopPlan


@dataclass(frozen=True)
class PlanRow:
    """A step of the day.

    Attributes:
        task: index of the task; -1 for a lesson that completes none of today's tasks.
        copies: copies of the task in this step, 0 for such a lesson.
        decision: what happens to them.
        robots: who attempts, or who is taught; empty if the person does it.
        lesson: index of the lesson that is used or given; -1 for pre-trained skills and the person.
        source: row in which the lesson that an attempt uses is given; -1 if it uses none.
        p_success: success probability of each copy.
        expected_cost: of all its copies together.
        certain_cost: the part of it that does not depend on failures.
    """

    task: int
    copies: int
    decision: Decision
    robots: tuple[int, ...]
    lesson: int
    source: int
    p_success: float
    expected_cost: float
    certain_cost: float


def plan_rows(shop: Shop, plan: ShopPlan) -> tuple[PlanRow, ...]:
    """Rows of a plan: first the lessons that complete none of today's tasks, then the tasks in order of work.

    Copies of a task that follow each other and are treated alike are one row. Costs are in the unit of the given costs.
    """
    task, size = shop.groups
    pupils: dict[int, list[int]] = {}
    for lesson, robot in plan.taught.tolist():
        pupils.setdefault(lesson, []).append(robot)
    rows: list[PlanRow] = []
    given: dict[int, int] = {}  # row of each lesson
    for lesson, robots in pupils.items():
        if shop.completes[lesson] < 0:
            given[lesson] = len(rows)
            price = float(shop.c_demo[robots, lesson].sum())
            rows.append(PlanRow(-1, 0, Decision.LEARN, tuple(robots), lesson, -1, 1.0, price, price))
    for group in plan.sequence.tolist():
        decision, lesson, robot = Decision(int(plan.decision[group])), int(plan.lesson[group]), int(plan.robot[group])
        cost, copies, source = float(plan.expected_cost[group]), int(size[group]), -1
        robots = [robot] if decision == Decision.ACT else []
        certain = cost
        if decision == Decision.ACT:
            certain = copies * float(shop.c_rob[robot, task[group]])
            source = given.get(lesson, -1)
        elif decision == Decision.LEARN:
            robots = pupils.get(lesson, [robot])
            given[lesson] = len(rows)
        chance = float(plan.p_success[group])
        row = PlanRow(int(task[group]), copies, decision, tuple(robots), lesson, source, chance, cost, certain)
        if rows and _alike(rows[-1], row):
            last = rows.pop()
            cost, certain, copies = cost + last.expected_cost, certain + last.certain_cost, copies + last.copies
            row = PlanRow(row.task, copies, decision, row.robots, lesson, source, chance, cost, certain)
        rows.append(row)
    return tuple(rows)


def _alike(one: PlanRow, other: PlanRow) -> bool:
    """Whether two rows are copies of one task that are treated alike; a lesson is given once."""
    same = (one.task, one.decision, one.robots, one.lesson) == (other.task, other.decision, other.robots, other.lesson)
    return same and one.decision != Decision.LEARN

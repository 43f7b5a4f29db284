"""Rows of a person's own about what happened, as events of a day.

Only `outcome`, and `task` where the plan's next step is not meant, have to be said: what is left out went as planned.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from p2l.errors import InputError
from p2l.team.columns import likeness
from p2l.team.day.advance import advance
from p2l.team.day.record import ALLOWED, Day, Event, EventError, EventOutcome, Step
from p2l.team.day.steps import next_step, planned_step
from p2l.team.problem import Decision
from p2l.team.shop.record import Shop
from p2l.text import guarded_cell

COLUMNS = ("step", "task", "copy", "decision", "robot", "lesson", "outcome", "note", "plan")
_DECISIONS = {each.name.lower(): each for each in Decision}
_OUTCOMES = {str(each): each for each in EventOutcome}


@dataclass(frozen=True)
class DayEntry:
    """A row: its line in a file, and its cells by column; what it does not have is left out."""

    line: int
    cells: Mapping[str, str]

    def __getitem__(self, column: str) -> str:
        """A cell, '' if there is none."""
        return self.cells.get(column, "").strip()


def event_of(day: Day, entry: DayEntry) -> Event:
    """The event that a row tells.

    Args:
        day: before it.
        entry: cells by the names of `COLUMNS`. Where `decision` is empty, robot and lesson are as planned; where it is
            not, an empty `lesson` of an attempt means pre-trained skills.

    Raises:
        EventError: a cell that names nothing there is.
    """
    if entry["step"] and entry["step"] != str(len(day.events) + 1):
        raise EventError("step", f"'{entry['step']}' given; {len(day.events) + 1} comes next")
    step = _step(day, entry)
    task, copy = step.task, step.copy
    if entry["copy"] and entry["copy"] != str(copy):
        if not re.fullmatch(r"\d{1,9}", entry["copy"]):
            raise EventError("copy", f"'{entry['copy']}' is no number of a copy")
        copy = int(entry["copy"])
    decision = _DECISIONS.get(entry["decision"].casefold()) if entry["decision"] else step.decision
    if decision is None:
        raise EventError("decision", f"'{entry['decision']}' is no decision; give {', '.join(_DECISIONS)}")
    outcome = _OUTCOMES.get(re.sub(r"[\s_-]+", " ", entry["outcome"].casefold()))
    if outcome is None:
        raise EventError("outcome", f"'{entry['outcome']}' is no outcome; give {', '.join(ALLOWED[decision])}")
    if not entry["decision"]:
        return Event(task, copy, step.decision, step.robot, step.lesson, outcome, note_of(entry))
    robot, lesson = _robot(day, entry, decision, step), _lesson(day, entry, decision, step)
    return Event(task, copy, decision, robot, lesson, outcome, note_of(entry))


def cells_of(shop: Shop, event: Event, step: int, key: str) -> dict[str, str]:
    """The row of an event of a morning's shop, step 1 the first, and the key of its plan."""
    return {
        "step": str(step),
        "task": guarded_cell(shop.tasks[event.task] if event.task >= 0 else shop.lessons[event.lesson]),
        "copy": str(event.copy),
        "decision": event.decision.name.lower(),
        "robot": guarded_cell(shop.robots[event.robot]) if event.robot >= 0 else "",
        "lesson": guarded_cell(shop.lessons[event.lesson]) if event.lesson >= 0 else "",
        "outcome": str(event.outcome),
        "note": guarded_cell(event.note),
        "plan": key,
    }


class Replay(NamedTuple):
    """The day after the last good row, and the first row that is wrong, with what is wrong with it."""

    day: Day
    wrong: DayEntry | None = None
    problem: InputError | None = None


def replay(
    day: Day, entries: Iterable[DayEntry], name: str, seen: Callable[[Day, Day], object] | None = None
) -> Replay:
    """Enter rows one by one, up to the first that cannot be.

    Args:
        day: before them.
        entries: rows.
        name: of their file, for messages.
        seen: called with the days before and after each row.
    """
    for entry in entries:
        try:
            after = advance(day, event_of(day, entry))
        except EventError as error:
            return Replay(day, entry, InputError.at(name, entry.line, error.field, error.problem))
        if seen is not None:
            seen(day, after)
        day = after
    return Replay(day)


def note_of(entry: DayEntry) -> str:
    """In one line, so that half a row is told; without the apostrophe that our own tables put before a formula."""
    note = " ".join(entry["note"].split())
    return note[1:] if note.startswith("'") and guarded_cell(note[1:]) == note else note


def _step(day: Day, entry: DayEntry) -> Step:
    """What the plan has for the row's task, or next if it names none."""
    following, name = next_step(day), entry["task"]
    if not name:
        if following is None:
            raise EventError("task", "all tasks are done; take the row out")
        return following
    shop = day.shop
    tasks = _names(shop.tasks)
    apart = _names(tuple(lesson for lesson, own in zip(shop.lessons, shop.completes, strict=True) if own < 0))
    if name in tasks:
        task = shop.tasks.index(tasks[name])
        if entry["copy"] == "0":
            lesson = next((k for k, own in enumerate(shop.completes.tolist()) if own == task), -1)
        elif (step := planned_step(day, task)) is not None:
            return step
        else:
            count = int(shop.count[task])
            raise EventError(
                "task", f"'{name}' is done{f', all {count} copies' if count > 1 else ''}; take the row out"
            )
    elif name in apart:
        task, lesson = -1, shop.lessons.index(apart[name])
    else:
        raise EventError("task", f"'{name}' is no task of this plan{likeness(name, [*tasks, *apart])}")
    robot = following.robot if following is not None and following.lesson == lesson else 0
    return Step(task, 0, Decision.LEARN, robot, lesson, 1.0, float(shop.c_demo[robot, lesson]))


def _robot(day: Day, entry: DayEntry, decision: Decision, step: Step) -> int:
    if decision == Decision.DELEGATE:
        return -1
    robots, name = _names(day.shop.robots), entry["robot"]
    if name in robots:
        return day.shop.robots.index(robots[name])
    if not name and (decision == step.decision or len(robots) == 1):
        return max(0, step.robot)
    raise EventError("robot", f"'{name}' is no robot; give {', '.join(robots)}")


def _lesson(day: Day, entry: DayEntry, decision: Decision, step: Step) -> int:
    if decision == Decision.DELEGATE:
        return -1
    lessons, name = _names(day.shop.lessons), entry["lesson"]
    if name in lessons:
        return day.shop.lessons.index(lessons[name])
    if name:
        raise EventError("lesson", f"'{name}' is no lesson of this plan{likeness(name, lessons)}")
    if decision == Decision.ACT:
        return -1
    if step.task < 0:
        return step.lesson
    return next((k for k, own in enumerate(day.shop.completes.tolist()) if own == step.task), -1)


def _names(names: tuple[str, ...]) -> dict[str, str]:
    """Names as they are, and as our own tables write them."""
    return {guarded_cell(name): name for name in names} | {name: name for name in names}

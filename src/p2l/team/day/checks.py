"""What can have happened on a day, and what cannot."""

from __future__ import annotations

import numpy as np

from p2l.team.day.record import ALLOWED, Day, Event, EventError
from p2l.team.problem import Decision


def check_event(day: Day, event: Event) -> None:
    """Refuse what cannot have happened.

    Raises:
        EventError: names the column that is wrong.
    """
    shop, standing = day.shop, day.standing
    if event.outcome not in ALLOWED[event.decision]:
        allowed = " or ".join(f"'{each}'" for each in ALLOWED[event.decision])
        raise EventError("outcome", f"'{event.outcome}' is no outcome of {event.decision.name.lower()}; give {allowed}")
    if event.copy != 0:
        _check_copy(day, event)
    elif event.decision != Decision.LEARN:
        raise EventError("copy", "0 is of lessons that complete no copy; give the number of the copy that is done")
    if event.decision == Decision.DELEGATE:
        if np.isinf(shop.c_hum[event.task]):
            raise EventError("decision", f"the person cannot do '{shop.tasks[event.task]}'; its c_hum is infinite")
        return
    if not 0 <= event.robot < len(shop.robots):
        raise EventError("robot", f"give the robot that did it: {', '.join(shop.robots)}")
    robot = shop.robots[event.robot]
    if event.decision == Decision.ACT:
        if event.lesson >= 0 and not standing.has(event.lesson, event.robot):
            problem = f"'{shop.lessons[event.lesson]}' has not been taught to '{robot}'; enter the lesson first, or "
            raise EventError("lesson", problem + "leave the cell empty for pre-trained skills")
        if np.isinf(shop.c_rob[event.robot, event.task]):
            raise EventError("decision", f"'{robot}' cannot attempt '{shop.tasks[event.task]}'; c_rob is infinite")
        return
    _check_lesson(day, event, robot)


def _check_copy(day: Day, event: Event) -> None:
    shop, done = day.shop, day.standing.done
    name, count = shop.tasks[event.task], int(shop.count[event.task])
    if done[event.task] == count:
        raise EventError("task", f"'{name}' is done{f', all {count} copies' if count > 1 else ''}; take the row out")
    if event.copy != done[event.task] + 1:
        raise EventError("copy", f"{event.copy} given; copy {done[event.task] + 1} of '{name}' is next")
    waiting = done < shop.count
    if shop.order == "fixed":
        first = np.flatnonzero(waiting[: event.task])
    else:
        before = shop.arcs[shop.arcs[:, 1] == event.task, 0]
        first = before[waiting[before]]
    if len(first):
        raise EventError("task", f"'{shop.tasks[int(first[0])]}' comes before '{name}', and is not done")


def _check_lesson(day: Day, event: Event, robot: str) -> None:
    shop, standing = day.shop, day.standing
    if event.lesson < 0:
        raise EventError("lesson", "give the lesson that was demonstrated")
    lesson, own = shop.lessons[event.lesson], int(shop.completes[event.lesson])
    if standing.has(event.lesson, event.robot):
        raise EventError("lesson", f"'{lesson}' has been taught to '{robot}' already")
    if np.isinf(shop.c_demo[event.robot, event.lesson]):
        raise EventError("lesson", f"'{lesson}' cannot be taught to '{robot}'; its c_demo is infinite")
    if event.copy and own != event.task:
        raise EventError("lesson", f"'{lesson}' is no demonstration of '{shop.tasks[event.task]}'")
    if not event.copy and own >= 0 and standing.shown != event.lesson:
        raise EventError(
            "copy", f"0 given; a demonstration of '{lesson}' completes a copy of it, unless it is the last"
        )
    if event.copy and any(each.lesson == event.lesson for each in standing.learnt):
        raise EventError("lesson", f"'{lesson}' has been demonstrated already; further robots learn from copy 0")

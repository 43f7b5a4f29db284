"""What every outcome has led to, kept beside `day.csv`: a day that goes on need not plan its past again.

`.progress.jsonl` has a line per event: the event, what it has cost and changed, and the plan for the rest after it. It
is a memory and no record: `day.csv` decides. A line holds only after all lines before it, for the same plan, settings
and time limit (a digest of each says so), and only as long as the row of `day.csv` tells the same event; and a plan is
taken from it only if it costs what it says on what is left of the shop. Whatever does not hold is planned again, from
the first row that is another.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from p2l.artifacts import config_hash, digest_bytes
from p2l.errors import ShapeError
from p2l.team.day.advance import standing_of
from p2l.team.day.entries import DayEntry, cells_of, note_of
from p2l.team.day.record import Day, Event, EventOutcome
from p2l.team.day.remaining import remaining_shop
from p2l.team.problem import Decision
from p2l.team.shop.outcome import shop_outcome
from p2l.team.shop.record import Ruling, ShopPlan

PROGRESS = ".progress.jsonl"
_VERSION = 1
_PLAN = ("planner", "status", "objective", "lower_bound", "gap")


@dataclass(frozen=True)
class DayProgress:
    """What an event has led to.

    Attributes:
        event: without its note, which changes nothing.
        spent: cost of what has happened, this event included.
        left: expected cost of the rest.
        change: what it has changed, in words.
        plan: of the rest; None if nothing is left.
        end: of its line, in bytes of the file.
        digest: of its line and all before it.
    """

    event: Event
    spent: float
    left: float
    change: str
    plan: Mapping[str, Any] | None
    end: int
    digest: str


def first_digest(morning: Day, key: str) -> str:
    """What the first line follows: the plan, its settings and its time limit."""
    return config_hash([_VERSION, key, morning.time_limit_s])


def read_progress(path: Path, morning: Day, key: str, entries: Sequence[DayEntry]) -> tuple[DayProgress, ...]:
    """The lines that hold for the first rows of `day.csv`; none if there is no such file, or it cannot be read.

    Args:
        path: of `.progress.jsonl`.
        morning: the day before its first event.
        key: of its plan.
        entries: rows of `day.csv`.
    """
    try:
        lines = path.read_bytes().splitlines(keepends=True)
    except OSError:
        return ()
    known: list[DayProgress] = []
    before, end = first_digest(morning, key), 0
    for line, entry in zip(lines, entries, strict=False):
        end += len(line)
        try:
            one = _progress(line, before, end, entry)
            if not _tells(entry, cells_of(morning.shop, one.event, len(known) + 1, key)):
                break
        except (ValueError, KeyError, TypeError, IndexError, AttributeError):
            break
        known.append(one)
        before = one.digest
    return tuple(known)


def day_after(morning: Day, known: Sequence[DayProgress]) -> Day | None:
    """The day after some events, its plan taken from the last line; None if that is no plan for what is left."""
    events = tuple(one.event for one in known)
    day = replace(morning, events=events, standing=standing_of(morning, events))
    rest = remaining_shop(day.shop, day.standing)
    plan = known[-1].plan if known else None
    if rest is None or plan is None:
        return replace(day, rest=None, plan=None) if rest is None and plan is None and known else None
    try:
        shop = rest.shop
        if plan["free"]:
            shop = replace(shop, choice=np.where(shop.choice == Ruling.LEARN, Ruling.FREE, shop.choice))
        most, longest = (float(each) for each in plan["limits"])
        rest = replace(rest, shop=replace(shop, max_lessons=most, max_teaching=longest))
        taught = np.array(plan["taught"], dtype=np.int64).reshape(-1, 2)
        sequence = np.array(plan["sequence"], dtype=np.int64)
        outcome = shop_outcome(rest.shop, taught, sequence)
    except (ShapeError, ValueError, KeyError, TypeError, IndexError):
        return None
    if not math.isclose(outcome.total, plan["objective"], rel_tol=1e-12):
        return None
    made = ShopPlan(
        **{name: plan[name] for name in _PLAN}, taught=taught, sequence=sequence, decision=outcome.decision,
        robot=outcome.robot, lesson=outcome.lesson, p_success=outcome.p_success, expected_cost=outcome.expected_cost,
        seconds=0.0,
    )  # fmt: skip
    return replace(day, rest=rest, plan=made)


def append_progress(path: Path, before: str, size: int, day: Day, change: str) -> tuple[str, int]:
    """Write what a day's last event has led to; returns the digest of the line and the size of the file then.

    A folder that cannot be written is no reason to stop a day: then nothing is remembered.

    Args:
        path: of `.progress.jsonl`.
        before: digest of the line that it follows.
        size: bytes that hold; what follows them is written over.
        day: with the event.
        change: what the event has changed, in words.
    """
    event, plan = day.events[-1], None
    if day.rest is not None and day.plan is not None:
        shop = day.rest.shop
        plan = {name: getattr(day.plan, name) for name in _PLAN} | {
            "taught": day.plan.taught.ravel().tolist(),
            "sequence": day.plan.sequence.tolist(),
            "free": not bool((shop.choice == Ruling.LEARN).any()),
            "limits": [shop.max_lessons, shop.max_teaching],
        }
    content = {
        "event": [event.task, event.copy, int(event.decision), event.robot, event.lesson, str(event.outcome)],
        "spent": day.spent,
        "left": day.left,
        "change": change,
        "plan": plan,
    }
    text = json.dumps(content)
    digest = digest_bytes(f"{before}{text}".encode())
    line = f"{digest} {text}\n".encode()
    try:
        with path.open("r+b" if path.exists() else "wb") as stream:
            stream.truncate(size)
            stream.seek(0, os.SEEK_END)
            stream.write(line)
    except OSError:  # the lines that are there still hold
        return before, size
    return digest, size + len(line)


def _progress(line: bytes, before: str, end: int, entry: DayEntry) -> DayProgress:
    """A line of the file; the note of its event is that of the row."""
    digest, _, text = line.decode().removesuffix("\n").partition(" ")
    if digest != digest_bytes(f"{before}{text}".encode()):
        raise ValueError("is not the line that followed")
    content = json.loads(text)
    task, copy, decision, robot, lesson, outcome = content["event"]
    event = Event(task, copy, Decision(decision), robot, lesson, EventOutcome(outcome), note_of(entry))
    return DayProgress(event, content["spent"], content["left"], content["change"], content["plan"], end, digest)


def _tells(entry: DayEntry, cells: Mapping[str, str]) -> bool:
    """Whether a row tells an event, every cell but its note."""
    return all(entry[name] == value for name, value in cells.items() if name != "note")

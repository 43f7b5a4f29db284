"""A walk through a day for the stage `day`: outcomes from a file or the terminal, each on disk before the next."""

from __future__ import annotations

import csv
import io
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from p2l.artifacts import write_text
from p2l.errors import InputError
from p2l.team.day import Day, Event, change_of, explain_change, next_step
from p2l.team.day.change import way
from p2l.team.day.entries import COLUMNS, DayEntry, cells_of, replay
from p2l.team.day.files import DAY, DayFile, append_event, restore
from p2l.team.day.progress import PROGRESS, append_progress, day_after, first_digest, read_progress
from p2l.team.day.record import ALLOWED
from p2l.team.problem import Decision
from p2l.team.shop.files import table_text
from p2l.text import guarded_cell, printable
from p2l.tracking import Tracker

REST, CHANGES = "rest.csv", "changes.csv"
_TYPED = ("task", "copy", "decision", "robot", "lesson", "outcome", "note")
_HELP = f"""  success, failure, done or not taught: how the step ended (the first letter will do)
  {",".join(_TYPED)}: what happened instead, cells as in day.csv
  q: stop here; the same command goes on"""


class Walk:
    """Where a day stands, in memory and in `day.csv`."""

    def __init__(self, path: Path, key: str, track: Tracker, extra: Mapping[str, tuple[str, ...]]) -> None:
        self.path, self.key, self.track, self.extra = path, key, track, extra
        self.size = -1  # of day.csv, once its rows are known to be good
        self.changes: list[tuple[str, ...]] = []
        self.memory, self.remembered = path.with_name(PROGRESS), ("", 0)  # digest and end of its last line
        self.day: Day
        self.file: DayFile
        self.wrong: DayEntry | None = None

    def go_on(self, morning: Day, file: DayFile) -> None:
        """Take up what stands in `day.csv`, up to its last good row, and say what comes next."""
        self.day, self.file = morning, file
        self.remembered = first_digest(morning, self.key), 0
        if not self.track.has_past:
            self._track(0, morning.spent, morning.left)
        done = self._recall(morning, file.entries)
        self.day, self.wrong, problem = replay(self.day, file.entries[done:], str(self.path), self._seen)
        if file.torn:
            torn = printable(file.torn, lines=False)
            print(f"{self.path}: its last row was not finished and is left out: {torn}")
        if problem is not None:
            print(f"{printable(str(problem))}. The day goes on from the row before; what follows is set aside then.")
        if self.day.events:
            print(f"{len(self.day.events)} outcomes are in {self.path}. {self._costs()}")

    def enter(self, entries: Iterable[DayEntry], name: str) -> None:
        """Enter the rows of a person's own table but for those that have their step and are in `day.csv` already.

        Raises:
            InputError: a row that cannot be, or is not as in `day.csv`; then none is entered, so that the table may be
                corrected and given again.
        """
        done, days = len(self.day.events), [self.day]
        try:
            rows = [entry for entry in entries if not self._is_there(entry, name, done)]
            _, _, problem = replay(self.day, rows, name, lambda _, after: days.append(after))
            if problem is not None:
                raise problem
        except InputError as error:
            raise InputError(f"{error}. No row of the table is entered") from error
        for after in days[1:]:
            self._enter(after)

    def ask(self) -> None:
        """Ask for one outcome after another until all is done, the person stops, or nothing more comes."""
        while (step := next_step(self.day)) is not None:
            print(self._step_text(), end=" ", flush=True)
            line = sys.stdin.readline()
            text = line.strip()
            if not line or text.casefold() in ("q", "quit"):
                print()
                return
            if text in ("", "?", "h", "help"):
                print(_HELP)
                continue
            cells = _cells(text, step.decision)
            after, _, problem = replay(self.day, [DayEntry(len(self.day.events) + 1, cells)], "typed")
            if problem is not None:
                print(f"{printable(str(problem))}. Nothing is entered.")
            else:
                self._enter(after)

    def write_rest(self) -> None:
        """Write the plan for the rest, and what every outcome has changed."""
        rest = self.path.with_name(REST)
        if self.day.rest is None or self.day.plan is None:
            rest.unlink(missing_ok=True)
        else:
            kept = self.day.rest.task.tolist()
            extra = {name: tuple(cells[task] for task in kept) for name, cells in self.extra.items()}
            write_text(rest, table_text(self.day.rest.shop, self.day.plan, extra))
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(["step", "task", "outcome", "spent", "expected_total", "change"])
        writer.writerows(self.changes)
        write_text(self.path.with_name(CHANGES), text.getvalue())

    def summary(self) -> str:
        """The last line of the stage."""
        day = self.day
        self.track.metrics({"outcomes": len(day.events), "cost": day.expected_total})
        left = 0 if day.rest is None else int(day.rest.shop.count.sum())
        if not left:
            return f"The day is done: {len(day.events)} outcomes, cost {day.spent:,.1f}."
        tasks = "1 task is" if left == 1 else f"{left} tasks are"
        return f"{tasks} left after {len(day.events)} outcomes. {self._costs()}"

    def _is_there(self, entry: DayEntry, name: str, done: int) -> bool:
        """Whether a row tells a step that is in `day.csv`, as it stands there."""
        if not entry["step"].isdecimal() or not 0 < int(entry["step"]) <= done:
            return False
        number = int(entry["step"])
        there = DayEntry(0, cells_of(self.day.shop, self.day.events[number - 1], number, self.key))
        for column in COLUMNS[1:-2]:
            given, known = (" ".join(each[column].casefold().split()) for each in (entry, there))
            if given not in ("", known):
                problem = (
                    f"'{entry[column]}' given, and {DAY} has '{there[column]}' in step {number}; correct one of them"
                )
                raise InputError.at(name, entry.line, column, problem)
        return True

    def _enter(self, after: Day) -> None:
        before = self.day
        if self.size < 0:
            self.size = restore(self.path, before, self.key, self.file, self.wrong)
        self.size = append_event(self.path, after, self.key, self.size)
        self.day = after
        print(self._seen(before, after))

    def _recall(self, morning: Day, entries: Sequence[DayEntry]) -> int:
        """Take up the rows of which it is known what they led to; returns how many these are."""
        known = read_progress(self.memory, morning, self.key, entries)
        day = day_after(morning, known)
        if day is None:
            return 0
        self.day, self.remembered = day, (known[-1].digest, known[-1].end)
        for number, one in enumerate(known, start=1):
            self._keep(number, one.event, one.spent, one.left, one.change)
            if not self.track.has_past:
                self._track(number, one.spent, one.left)
        return len(known)

    def _seen(self, before: Day, after: Day) -> str:
        """Keep and return what an outcome has changed."""
        self.day = after
        told = explain_change(after.shop, change_of(before, after))
        self.remembered = append_progress(self.memory, *self.remembered, after, told)
        self._track(len(after.events), after.spent, after.left)
        return self._keep(len(after.events), after.events[-1], after.spent, after.left, told)

    def _keep(self, number: int, event: Event, spent: float, left: float, told: str) -> str:
        shop = self.day.shop
        name = shop.tasks[event.task] if event.task >= 0 else shop.lessons[event.lesson]
        costs = (f"{spent:.12g}", f"{spent + left:.12g}")
        self.changes.append((str(number), guarded_cell(name), str(event.outcome), *costs, guarded_cell(told)))
        return f"{number}. {printable(name, lines=False)}: {event.outcome}; {told}"

    def _track(self, step: int, spent: float, left: float) -> None:
        self.track.metrics({"objective": left, "spent": spent, "expected_total": spent + left}, step=step)

    def _costs(self) -> str:
        return f"Spent {self.day.spent:,.1f}, expected for the rest {self.day.left:,.1f}."

    def _step_text(self) -> str:
        day = self.day
        step = next_step(day)
        assert step is not None
        shop = day.shop
        name = printable(shop.tasks[step.task] if step.task >= 0 else shop.lessons[step.lesson], lines=False)
        many = int(shop.count[step.task]) if step.task >= 0 else 1
        copy = f" (copy {step.copy} of {many})" if many > 1 and step.copy else ""
        how = way(shop, (step.decision, step.robot, step.lesson))
        chance = f", succeeds with {step.p_success:.0%}" if step.decision == Decision.ACT else ""
        allowed = " / ".join(ALLOWED[step.decision])
        return f"{len(day.events) + 1}. {name}{copy}: {how}{chance}. {allowed}?"


def _cells(text: str, decision: Decision) -> dict[str, str]:
    """A line from the terminal as cells of a row: an outcome or its beginning, or cells in the order of `_TYPED`."""
    if "," in text:
        return dict(zip(_TYPED, next(csv.reader([text])), strict=False))
    near = [each for each in ALLOWED[decision] if each.startswith(text.casefold())]
    return {"outcome": str(near[0]) if len(near) == 1 else text}

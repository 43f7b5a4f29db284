"""Today's orders as a person has them: costs, copies, decisions that are made, how surely a demonstration teaches.

`demo_success` q says that a demonstration is learnt with probability q. Without `demo_tries` it is repeated until it
is learnt, 1 / q times on average; with `demo_tries` m it is given m times, and what is then known of it is the
probability 1 - (1 - q)^m. Neither is in the thesis, whose demonstrations always teach.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from p2l.errors import InputError
from p2l.records import Array, BoolArray, IntArray
from p2l.team.cells import LARGEST, quoted
from p2l.team.columns import distinct_names, known_columns
from p2l.team.sheets import Sheet, flag, number, probability, whole_number
from p2l.team.shop.record import Ruling

NEEDED = ("task", "c_rob", "c_hum", "c_fail", "c_demo")
KNOWN = (*NEEDED, "pretrained", "decision", "count", "teachable", "demo_success", "demo_tries", "family")
_CHOICES = {
    "": Ruling.FREE,
    "act": Ruling.ACT,
    "delegate": Ruling.DELEGATE,
    "learn": Ruling.LEARN,
    "!learn": Ruling.NOT_LEARN,
}
_MOST_COPIES = 1_000_000


@dataclass(frozen=True)
class Orders:
    """A table of n tasks; costs as written, of one demonstration too.

    Attributes:
        name: of the file, for messages.
        tasks: n names.
        lines: n lines of the file.
        c_rob: [n] as in `Problem`.
        c_hum: [n] as in `Problem`.
        c_fail: [n] as in `Problem`.
        c_demo: [n] cost of one demonstration.
        pretrained: [n] as in `Problem`.
        teachable: [n] whether the task can be taught at all.
        demos: [n] how many demonstrations a lesson takes, on average.
        learnt: [n] probability that they teach it.
        choice: [n] a `Ruling`.
        decision: name of the column of `choice`, as written; None if there is none.
        count: [n] copies.
        family: [n] names, '' where there is none; None without such a column.
        extra: n cells of each column that is not ours, by its name as written.
        remarks: what was assumed.
    """

    name: str
    tasks: tuple[str, ...]
    lines: tuple[int, ...]
    c_rob: Array
    c_hum: Array
    c_fail: Array
    c_demo: Array
    pretrained: Array
    teachable: BoolArray
    demos: Array
    learnt: Array
    choice: IntArray
    decision: str | None
    count: IntArray
    family: tuple[str, ...] | None
    extra: Mapping[str, tuple[str, ...]]
    remarks: tuple[str, ...]


def read_orders(sheet: Sheet) -> Orders:
    """Check every cell of a table of orders.

    Args:
        sheet: columns `task,c_rob,c_hum,c_fail,c_demo`, optionally `pretrained`, `decision`, `count`, `teachable`,
            `demo_success`, `demo_tries` and `family`, and any others.

    Raises:
        InputError: a missing or misspelt column, a missing or repeated task, a cell that does not hold what it should.
    """
    at = known_columns(sheet, KNOWN, NEEDED)
    lines = tuple(line for line, _ in sheet.rows)

    def cells(name: str) -> list[tuple[int, str, str]]:
        """(line, column, cell)."""
        place = at[name]
        return [(line, sheet.header[place], row[place]) for line, row in sheet.rows]

    def column(name: str, read: Callable[[int, str, str], float], default: float) -> Array:
        if name not in at:
            return np.full(len(lines), default)
        return np.array([read(*cell) for cell in cells(name)], dtype=np.float64)

    tasks = distinct_names(sheet, [(line, cell) for line, _, cell in cells("task")], sheet.header[at["task"]], "task")
    costs = {name: column(name, lambda *cell: number(sheet, *cell), 0.0) for name in NEEDED[1:]}
    success = column("demo_success", lambda *cell: _success(sheet, *cell), np.nan)
    tries = column("demo_tries", lambda *cell: _at_least_one(sheet, *cell, largest=10**9, empty=np.nan), np.nan)
    demos, learnt, remarks = _demonstrations(sheet, at, tasks, costs["c_demo"], success, tries)
    extra = sheet.extra(KNOWN)
    return Orders(
        name=sheet.name,
        tasks=tasks,
        lines=lines,
        **costs,
        pretrained=column("pretrained", lambda *cell: probability(sheet, *cell, empty=0.0), 0.0),
        teachable=column("teachable", lambda *cell: flag(sheet, *cell, empty=True), 1.0) > 0.0,
        demos=demos,
        learnt=learnt,
        choice=column("decision", lambda *cell: _choice(sheet, *cell), Ruling.FREE).astype(np.int64),
        decision=sheet.header[at["decision"]] if "decision" in at else None,
        count=column("count", lambda *cell: _at_least_one(sheet, *cell, largest=_MOST_COPIES, empty=1.0), 1.0).astype(
            np.int64
        ),
        family=tuple(cell for _, _, cell in cells("family")) if "family" in at else None,
        extra={name: tuple(row[sheet.header.index(name)] for _, row in sheet.rows) for name in extra},
        remarks=remarks,
    )


def _choice(sheet: Sheet, line: int, column: str, text: str) -> float:
    word = re.sub(r"\s", "", text).casefold()
    if word not in _CHOICES:
        problem = f"{quoted(text)} is no decision; give act, delegate, learn, !learn (not taught), or leave it empty"
        raise InputError.at(sheet.name, line, column, problem)
    return float(_CHOICES[word])


def _success(sheet: Sheet, line: int, column: str, text: str) -> float:
    value = probability(sheet, line, column, text, empty=np.nan)
    if value == 0.0:
        problem = f"{quoted(text)} is not allowed; give a probability above 0, or teachable=no if nothing teaches it"
        raise InputError.at(sheet.name, line, column, problem)
    return value


def _at_least_one(sheet: Sheet, line: int, column: str, text: str, *, largest: int, empty: float) -> float:
    if not text:
        return empty
    value = whole_number(sheet, line, column, text, largest=largest)
    if value == 0:
        problem = f"{quoted(text)} is not allowed; give a whole number of at least 1, or take the row out"
        raise InputError.at(sheet.name, line, column, problem)
    return float(value)


def _demonstrations(
    sheet: Sheet, at: Mapping[str, int], tasks: tuple[str, ...], c_demo: Array, success: Array, tries: Array
) -> tuple[Array, Array, tuple[str, ...]]:
    """How many demonstrations a lesson takes, with what probability they teach it, and what is to be said of that."""
    is_counted = ~np.isnan(tries)
    if (unknown := is_counted & np.isnan(success)).any():
        row = int(unknown.argmax())
        problem = f"task '{tasks[row]}' needs a demo_success: how probably one demonstration teaches it"
        raise InputError.at(sheet.name, sheet.rows[row][0], sheet.header[at["demo_tries"]], problem)
    success = np.nan_to_num(success, nan=1.0)
    with np.errstate(over="ignore", invalid="ignore"):
        demos = np.where(is_counted, tries, 1.0 / success)
        too_much = np.isfinite(c_demo) & ~(c_demo * demos <= LARGEST)
    learnt = np.where(is_counted, 1.0 - (1.0 - success) ** np.where(is_counted, tries, 1.0), 1.0)
    if too_much.any():
        row = int(too_much.argmax())
        problem = f"so many demonstrations of '{tasks[row]}' cost more than {LARGEST:g}; give teachable=no"
        name = "demo_tries" if is_counted[row] else "demo_success"
        raise InputError.at(sheet.name, sheet.rows[row][0], sheet.header[at[name]], problem)
    remarks = []
    if (repeated := (success < 1.0) & ~is_counted).any():
        remarks.append(
            f"a demonstration is repeated until it has taught, at c_demo / demo_success ({_tasks(tasks, repeated)})"
        )
    if is_counted.any():
        text = "demonstrations are given demo_tries times, and nobody looks whether they have taught"
        remarks.append(f"{text} ({_tasks(tasks, is_counted)})")
    return demos, learnt, tuple(remarks)


def _tasks(tasks: tuple[str, ...], which: BoolArray) -> str:
    return listed([tasks[each] for each in np.flatnonzero(which)])


def listed(names: list[str], most: int = 4) -> str:
    """Some of the names, and how many more there are."""
    quoted_names = [quoted(name) for name in names[:most]]
    return ", ".join(quoted_names) + (f" and {len(names) - most} more" if len(names) > most else "")

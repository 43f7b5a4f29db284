"""The form of a transfer table, its lessons and their cost; `measurements` reads the probabilities.

Lessons are what the table has rows for. Those that are none of today's tasks can be given, too, if `c_demo` is known.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path

import numpy as np

from p2l.errors import InputError
from p2l.team.cells import normal
from p2l.team.columns import ALIKE, check_name, distinct_names, known_columns
from p2l.team.sheets import Sheet, number
from p2l.team.shop.orders import Orders
from p2l.text import guarded_cell

_PAIR = ("taught", "tested")
_MEANS = ("p", "probability", "mean")
_COMPARED = 20_000  # pairs of names, in about 0.1 s; a table of so many others is a catalogue
COUNTS = ("successes", "attempts")


@dataclass(frozen=True)
class TransferTable:
    """A table whose probabilities are still text.

    Attributes:
        sheet: the table; None if a person has none.
        at: places of known columns; of a table with a row per pair if it has `taught`.
        taught: the lesson of each row.
        c_demo: cost of a demonstration of each lesson, NaN where the table does not say it.
    """

    sheet: Sheet | None
    at: Mapping[str, int]
    taught: tuple[str, ...]
    c_demo: Mapping[str, float]

    @property
    def name(self) -> str:
        """Of the file."""
        return "the transfer table" if self.sheet is None else Path(self.sheet.name).name

    @property
    def tested(self) -> tuple[str, ...]:
        """Tasks that it has columns or rows for, as written."""
        if self.sheet is None:
            return ()
        if "tested" in self.at:
            return tuple(dict.fromkeys(cells[self.at["tested"]] for _, cells in self.sheet.rows))
        return tuple(name for at, name in enumerate(self.sheet.header) if at not in (0, self.at.get("c_demo")))


def open_table(sheet: Sheet | None, orders: Orders) -> TransferTable:
    """Find out the form of a table, its lessons and what they cost.

    Args:
        sheet: a header with `taught`, `tested` and `p` (or `probability`, `mean`, or `successes` and `attempts`), and
            a row per pair; or a row per lesson and a column per task. In both, `c_demo` may be a column.
        orders: of today.

    Raises:
        InputError: a misspelt column, a lesson without a name, or twice where it has one row; a table without any of
            today's tasks; a cost that the orders or another row contradict.
    """
    if sheet is None:
        return TransferTable(None, {}, (), {})
    is_long = len(sheet.columns(_PAIR)) == len(_PAIR) and not set(_PAIR) & set(orders.tasks)
    at = _long_columns(sheet) if is_long else _wide_columns(sheet, orders)
    place = at["taught"] if is_long else 0
    column = sheet.header[place] or None
    taught = names_of(sheet, place, "lesson", orders.tasks)
    if not is_long:
        lines = (line for line, _ in sheet.rows)
        distinct_names(sheet, zip(lines, taught, strict=True), column, "taught task")
    return TransferTable(sheet, at, taught, _costs(sheet, at.get("c_demo"), taught, orders))


def misspelt(table: TransferTable, tasks: tuple[str, ...]) -> tuple[str, ...]:
    """Hints: names that are no task of today, and much like one that the table has no row, or no column, for.

    Args:
        table: of transfer.
        tasks: names as the orders have them.
    """
    known, hints = set(tasks), []
    for given in (table.taught, table.tested):
        names = dict.fromkeys(as_ordered(given, tasks).values())
        lost, others = [task for task in tasks if task not in names], [name for name in names if name not in known]
        if len(lost) * len(others) > _COMPARED:
            continue
        for name in others:
            if close := difflib.get_close_matches(name, lost, n=1, cutoff=ALIKE):
                hints.append(f"'{name}' is no task of the orders; is it '{close[0]}'?")
    return tuple(dict.fromkeys(hints))


def names_of(sheet: Sheet, place: int, what: str, tasks: tuple[str, ...]) -> tuple[str, ...]:
    """The names in a column, as the orders write them.

    Args:
        sheet: a table.
        place: of the column.
        what: it names.
        tasks: names as the orders have them.

    Raises:
        InputError: an empty name, one with control characters, or one that the orders spell in another way.
    """
    column = sheet.header[place] or None
    first: dict[str, int] = {}
    for line, cells in sheet.rows:
        first.setdefault(cells[place], line)
    for name, line in first.items():
        check_name(sheet, line, column, what, name)
    ordered = as_ordered(first, tasks)
    refuse_other_spellings([(line, column, ordered[name]) for name, line in first.items()], sheet, tasks)
    return tuple(ordered[cells[place]] for _, cells in sheet.rows)


def as_ordered(names: Iterable[str], tasks: tuple[str, ...]) -> dict[str, str]:
    """Names without the apostrophe that our own tables put before what a spreadsheet would run.

    Args:
        names: in a table.
        tasks: names as the orders have them.
    """
    known = {guarded_cell(name): name for name in tasks} | {name: name for name in tasks}
    return {name: known.get(name, name) for name in names}


def refuse_other_spellings(cells: Iterable[tuple[int, str | None, str]], sheet: Sheet, tasks: tuple[str, ...]) -> None:
    """Refuse "Lid" where "lid" is meant: a gap would be filled, and nobody would know.

    Args:
        cells: (line, column, name).
        sheet: that they are of.
        tasks: names as the orders have them.

    Raises:
        InputError: a task is missing, and a name is the same but for capitals, spaces, hyphens and underscores.
    """
    given: dict[str, tuple[int, str | None]] = {}
    for line, column, name in cells:
        given.setdefault(name, (line, column))
    lost = {normal(task): task for task in tasks if task not in given}
    known = set(tasks)
    for name in given if lost else ():
        if name not in known and (task := lost.get(normal(name))):
            problem = f"'{name}' is '{task}' in the orders; write it alike"
            raise InputError.at(sheet.name, *given[name], problem)


def _long_columns(sheet: Sheet) -> dict[str, int]:
    known = (*_PAIR, "robot", "c_demo")
    at = known_columns(sheet, known, _PAIR, "pair")
    means, counts = sheet.columns(_MEANS), sheet.columns(COUNTS)
    if len(means) > 1:
        first, second, *_ = means
        problem = f"means '{first}', and so does '{second}'; keep one"
        raise InputError.at(sheet.name, sheet.header_line, sheet.header[means[first]], problem)
    if means:
        return {**at, "p": next(iter(means.values())), **sheet.columns(("n",))}
    if not counts:
        close = [name for name in sheet.extra(known) if difflib.get_close_matches(normal(name), (*_MEANS, *COUNTS))]
        hint = f"; is it '{close[0]}'?" if close else ""
        raise InputError.at(sheet.name, sheet.header_line, "p", f"column is missing; every pair needs it{hint}")
    return {**at, **known_columns(sheet, COUNTS, COUNTS, "pair")}


def _wide_columns(sheet: Sheet, orders: Orders) -> dict[str, int]:
    has_task = "c_demo" in orders.tasks
    place = {name: at for name, at in sheet.columns(("c_demo",)).items() if at and not has_task}
    header = [name for at, name in enumerate(sheet.header) if at not in (0, place.get("c_demo"))]
    names = list(as_ordered(header, orders.tasks).values())
    distinct_names(sheet, zip(repeat(sheet.header_line), names, strict=False), None, "tested task")
    refuse_other_spellings([(sheet.header_line, name, name) for name in names], sheet, orders.tasks)
    known = set(orders.tasks)
    others = [name for name in names if name not in known]
    if not place and (close := difflib.get_close_matches("c_demo", others, n=1, cutoff=ALIKE)):
        problem = "unknown column; write 'c_demo' if that is meant, or else a name that is less like it"
        raise InputError.at(sheet.name, sheet.header_line, close[0], problem)
    if len(others) == len(names):
        problem = f"no column is for a task of {Path(orders.name).name}; give one for each, or columns taught,tested,p"
        raise InputError.at(sheet.name, sheet.header_line, None, problem)
    return place


def _costs(sheet: Sheet, place: int | None, taught: Sequence[str], orders: Orders) -> dict[str, float]:
    costs = dict.fromkeys(taught, np.nan)
    if place is None:
        return costs
    written: dict[str, str] = {}
    known = {task: float(cost) for task, cost in zip(orders.tasks, orders.c_demo, strict=True)}
    column = sheet.header[place]
    for (line, cells), name in zip(sheet.rows, taught, strict=True):
        if not cells[place]:
            continue
        cost = number(sheet, line, column, cells[place])
        if cost != known.setdefault(name, cost):
            where = f"'{written[name]}' in an earlier row" if name in written else f"{known[name]:g} in the orders"
            raise InputError.at(sheet.name, line, column, f"{cost:g} for '{name}', which costs {where}; keep one")
        written[name] = cells[place]
        costs[name] = cost
    return costs

"""A person's features, trials and orders, as records. What comes out is `p2l.team.transfer_files`'s.

The tables are read by `p2l.team.sheets`: any CSV, or an .xlsx workbook.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from p2l.errors import InputError, ShapeError
from p2l.records import IntArray
from p2l.team.cells import LARGEST, is_number, quoted
from p2l.team.columns import distinct_names, known_columns, likeness
from p2l.team.problem import Order, Problem
from p2l.team.sheets import Sheet, flag, number, read_sheet, whole_number
from p2l.team.shop.orders import read_orders as read_shop_orders
from p2l.team.shop.record import Ruling
from p2l.transfer.few_trials import TaskTable, Trials

_COUNTS, _SINGLE = ("taught", "tested", "successes", "attempts"), ("taught", "tested", "success")
_MOST_ATTEMPTS = 10_000  # of one row; more is a slip
_MOST_ORDERS = 10_000  # copies counted

Cells = list[tuple[int, str, str]]  # line, column as written, cell


def read_features(path: Path) -> TaskTable:
    """Tasks and their features: column `task`, optionally `family`, all others numbers or categories.

    A column whose cells are all numbers, of any sign, is numeric; one that has no number at all is a category.

    Args:
        path: as `sheets.read_sheet` takes it.

    Raises:
        InputError: no table; a task without a name or twice; a column that mixes numbers and text, has a gap, or has
            no name.
    """
    sheet = read_sheet(path)
    at = known_columns(sheet, ("task", "family"), ("task",))
    tasks = [(line, cell) for line, _, cell in _cells(sheet, at["task"])]
    names = distinct_names(sheet, tasks, sheet.header[at["task"]], "task")
    numeric: dict[str, list[float]] = {}
    categories: dict[str, list[str]] = {}
    for place, column in enumerate(sheet.header):
        if place in at.values():
            continue
        if not column:
            raise InputError.at(sheet.name, sheet.header_line, None, "a column has no name; name it")
        cells = _cells(sheet, place)
        are_numbers = [is_number(cell) for _, _, cell in cells]
        ways = "give every task a number, or every task a word"
        for (line, _, cell), is_one in zip(cells, are_numbers, strict=True):
            if not cell:
                raise InputError.at(sheet.name, line, column, f"is empty; {ways}")
            if any(are_numbers) and not is_one:
                problem = f"{quoted(cell)} is not a number, and other rows have numbers here; {ways}"
                raise InputError.at(sheet.name, line, column, problem)
        if any(are_numbers):
            numeric[column] = [number(sheet, *each, lowest=-LARGEST, empty=None, never=False) for each in cells]
        else:
            categories[column] = [cell for _, _, cell in cells]
    family = None
    if "family" in at:
        cells = _cells(sheet, at["family"])
        if empty := [(line, column) for line, column, cell in cells if not cell]:
            raise InputError.at(sheet.name, *empty[0], "is empty; name a family, or leave the column out")
        family = _codes([cell for _, _, cell in cells])
    if not numeric and not categories and family is None:
        raise InputError.at(sheet.name, None, None, "has no features; add a column of numbers or words, or 'family'")
    m = len(names)
    return TaskTable(
        names=names,
        numeric_names=tuple(numeric),
        numeric=np.array(list(numeric.values()), dtype=np.float64).reshape(len(numeric), m).T,
        category_names=tuple(categories),
        category=np.array([_codes(each) for each in categories.values()], dtype=np.int64).reshape(-1, m).T,
        family=family,
    )


def read_trials(path: Path, names: Sequence[str], features: Path) -> Trials:
    """Trials as `taught,tested,successes,attempts`, or one per row as `taught,tested,success`; pairs are pooled.

    Args:
        path: as `sheets.read_sheet` takes it.
        names: tasks that have features.
        features: their file, for messages.

    Raises:
        InputError: no table, or one without rows; other columns; an unknown task; counts that are none.
    """
    sheet = read_sheet(path)
    kinds = [kind for kind in (_COUNTS, _SINGLE) if len(sheet.columns(kind)) == len(kind) == len(sheet.header)]
    if not kinds:
        expected = f"expected {','.join(_COUNTS)} or {','.join(_SINGLE)}"
        problem = f"has columns {quoted(','.join(sheet.header))}; {expected}"
        raise InputError.at(sheet.name, sheet.header_line, None, problem)
    if not sheet.rows:
        raise InputError.at(sheet.name, None, None, "has a header but no trials; add one row per pair or trial")
    at = sheet.columns(kinds[0])
    index = {name: task for task, name in enumerate(names)}
    pairs = [_tasks(sheet, _cells(sheet, at[column]), index, features) for column in ("taught", "tested")]
    if kinds[0] == _SINGLE:
        successes = [int(flag(sheet, *cell, empty=None)) for cell in _cells(sheet, at["success"])]
        attempts = [1] * len(successes)
    else:
        counts = (_cells(sheet, at[name]) for name in ("successes", "attempts"))
        successes, attempts = ([whole_number(sheet, *cell, largest=_MOST_ATTEMPTS) for cell in each] for each in counts)
        for (line, _), wins, total in zip(sheet.rows, successes, attempts, strict=True):
            if total == 0:
                problem = "'0' is not allowed; give at least 1, or take the row out"
                raise InputError.at(sheet.name, line, sheet.header[at["attempts"]], problem)
            if wins > total:
                problem = f"{wins} of {total} attempts; there cannot be more"
                raise InputError.at(sheet.name, line, sheet.header[at["successes"]], problem)
    return Trials.pooled(pairs[0], pairs[1], np.array(successes), np.array(attempts))


def read_orders(path: Path, names: Sequence[str], features: Path, order: Order) -> tuple[Problem, IntArray]:
    """A day's orders, and the task [n] behind each of its rows.

    The columns are those of `shop.orders.read_orders`. Further copies of a task are rows of their own, which are not
    taught. Decisions are costs: what they rule out costs infinitely much. The transfer table has the probability that
    the demonstrations of a lesson (row) teach it, 1 without `demo_tries`.

    Args:
        path: as `sheets.read_sheet` takes it.
        names: tasks that have features.
        features: their file, for messages.
        order: of work.

    Raises:
        InputError: as `shop.orders.read_orders`; a task without features; too many copies; a task that nobody can do.
    """
    sheet = read_sheet(path)
    orders = read_shop_orders(sheet)
    index = {name: task for task, name in enumerate(names)}
    tasks = _tasks(sheet, _cells(sheet, sheet.columns(("task",))["task"]), index, features)
    if (total := int(orders.count.sum())) > _MOST_ORDERS:
        raise InputError.at(sheet.name, None, "count", f"{total} tasks in all; at most {_MOST_ORDERS}")
    rows = np.repeat(np.arange(len(tasks)), orders.count)
    copy = np.concatenate([np.arange(count) for count in orders.count])
    labels = [
        f"{orders.tasks[row]} ({nth + 1})" if nth else orders.tasks[row] for row, nth in zip(rows, copy, strict=True)
    ]
    first, choice = copy == 0, orders.choice[rows]
    teach = first & orders.teachable[rows] & np.isin(choice, (Ruling.FREE, Ruling.LEARN))
    ruled_out = first & (choice == Ruling.LEARN)  # for all but a lesson
    try:
        problem = Problem(
            tasks=tuple(labels),
            c_rob=np.where(ruled_out | (choice == Ruling.DELEGATE), np.inf, orders.c_rob[rows]),
            c_hum=np.where(ruled_out | (choice == Ruling.ACT), np.inf, orders.c_hum[rows]),
            c_fail=orders.c_fail[rows],
            c_demo=np.where(teach, (orders.c_demo * orders.demos)[rows], np.inf),
            pretrained=orders.pretrained[rows],
            transfer=np.repeat(orders.learnt[rows][:, None], len(rows), axis=1),
            order=order,
        )
    except ShapeError as error:
        raise InputError.at(sheet.name, None, None, str(error)) from error
    return problem, tasks[rows]


def _cells(sheet: Sheet, place: int) -> Cells:
    return [(line, sheet.header[place], row[place]) for line, row in sheet.rows]


def _tasks(sheet: Sheet, cells: Cells, index: Mapping[str, int], features: Path) -> IntArray:
    """Task of each cell of a column of names."""
    for line, column, name in cells:
        if name not in index:
            what = likeness(name, index, "; add its features")
            raise InputError.at(sheet.name, line, column, f"task {quoted(name)} is not in {features.name}{what}")
    return np.array([index[name] for _, _, name in cells], dtype=np.int64)


def _codes(cells: Sequence[str]) -> IntArray:
    return np.unique(np.array(cells), return_inverse=True)[1].astype(np.int64)

"""A person's own tasks: `orders.csv` and `transfer.csv`; what comes out is `p2l.team.plan_files`'s.

Reading stops at the first thing that is wrong, with one message that names the file, the row (as a spreadsheet counts
them, the header is row 1) and the column.
"""

from __future__ import annotations

import csv
import math
from collections import Counter
from pathlib import Path

import numpy as np

from p2l.errors import ConfigError, InputError, ShapeError
from p2l.records import Array
from p2l.team.problem import ORDERS, Order, Problem

_COSTS = ("c_rob", "c_hum", "c_fail", "c_demo")
_ORDERS_COLUMNS = ("task", *_COSTS)
_LARGEST = 1e100  # said in a message; a larger cost is a slip, and sums of such costs overflow

Row = tuple[int, list[str]]


def read_problem(orders_csv: Path | str, transfer_csv: Path | str, order: Order = "fixed") -> Problem:
    r"""Read tasks in work order and the transfer table.

    Args:
        orders_csv: columns `task,c_rob,c_hum,c_fail,c_demo` and optionally `pretrained` (a probability, 0 if absent). A
            cost that is `inf`, or left empty, stands for what is not possible.
        transfer_csv: square; first column the taught task, first row the tested task, cells probabilities. Rows and
            columns may come in any order.
        order: "fixed" or "any".

    Raises:
        InputError: a file that is missing, empty or not a CSV; an unknown, missing or repeated column; a missing, extra
            or repeated task; a cell that is no number, NaN, negative, or no probability; a task that nobody can do.
        ConfigError: an unknown order.

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from p2l import read_problem
        >>> with TemporaryDirectory() as folder:
        ...     orders, transfer = Path(folder) / "orders.csv", Path(folder) / "transfer.csv"
        ...     _ = orders.write_text("task,c_rob,c_hum,c_fail,c_demo,pretrained\ngear,10,100,100,200,0.95\n")
        ...     _ = transfer.write_text("task,gear\ngear,0.95\n")
        ...     problem = read_problem(orders, transfer)
        >>> problem.tasks, problem.pretrained.tolist()
        (('gear',), [0.95])
    """
    if order not in ORDERS:
        raise ConfigError(f"order: '{order}' is unknown; use one of {list(ORDERS)}")
    orders, transfer = Path(orders_csv), Path(transfer_csv)
    header, rows = _table(orders)
    missing = [name for name in _ORDERS_COLUMNS if name not in header]
    for name in header:
        if name not in (*_ORDERS_COLUMNS, "pretrained"):
            columns = f"{','.join(_ORDERS_COLUMNS)} and optionally pretrained, separated by commas"
            raise InputError.at(orders, 1, name, f"unknown column; allowed are {columns}")
    if missing:
        raise InputError.at(orders, 1, missing[0], "column is missing; every task needs it")
    at = {name: place for place, name in enumerate(header)}
    tasks = _names(orders, [(line, cells[at["task"]]) for line, cells in rows], "task", "task")
    costs = {
        name: np.array([_number(orders, line, name, cells[at[name]], _LARGEST) for line, cells in rows])
        for name in _COSTS
    }
    pretrained = np.zeros(len(tasks))
    if "pretrained" in at:
        cells_of = [(line, cells[at["pretrained"]]) for line, cells in rows]
        pretrained = np.array([_number(orders, line, "pretrained", text, 1.0) for line, text in cells_of])
    table = _read_transfer(transfer, tasks, orders)
    try:
        return Problem(tasks=tasks, **costs, pretrained=pretrained, transfer=table, order=order)
    except ShapeError as error:
        raise InputError.at(orders, None, None, str(error)) from error


def _read_transfer(path: Path, tasks: tuple[str, ...], orders: Path) -> Array:
    header, rows = _table(path)
    tested_tasks = _names(path, [(1, name) for name in header[1:]], None, "tested task")
    taught_tasks = _names(path, [(line, cells[0]) for line, cells in rows], header[0] or None, "taught task")
    place = {name: index for index, name in enumerate(tasks)}
    for names, row in ((tested_tasks, 1), (taught_tasks, None)):
        present = set(names)
        side = "column" if row else "row"
        for name in names:
            if name not in place:
                at = row or rows[taught_tasks.index(name)][0]
                raise InputError.at(
                    path, at, name if row else None, f"task '{name}' is not in {orders.name}; remove it"
                )
        if missing := [name for name in tasks if name not in present]:
            raise InputError.at(path, row, None, f"has no {side} for task '{missing[0]}' of {orders.name}; add it")
    table = np.empty((len(tasks), len(tasks)))
    columns = [place[name] for name in tested_tasks]
    for (line, cells), name in zip(rows, taught_tasks, strict=True):
        table[place[name], columns] = _probabilities(path, line, tested_tasks, cells[1:])
    return table


def _probabilities(path: Path, line: int, tasks: tuple[str, ...], cells: list[str]) -> Array:
    """One row at once; cell by cell only to find out what is wrong."""
    try:
        values = np.array(cells if not any("_" in cell for cell in cells) else [np.nan], dtype=np.float64)
    except ValueError:
        values = np.array([np.nan])
    if not bool(((values >= 0.0) & (values <= 1.0)).all()):
        return np.array([_number(path, line, name, cell, 1.0) for name, cell in zip(tasks, cells, strict=True)])
    return values


def _number(path: Path, line: int, column: str, text: str, largest: float) -> float:
    is_cost = largest != 1.0
    what = "a cost of at least 0 and at most 1e100, or inf for never" if is_cost else "a probability in [0, 1]"
    if is_cost and text.lower() in ("", "inf", "infinity"):
        return math.inf
    try:
        value = float(text.replace("_", "?"))  # Python would read 1_0 as 10
    except ValueError:
        raise InputError.at(path, line, column, f"'{text}' is not a number; give {what}") from None
    if not 0.0 <= value <= largest:  # also refuses NaN
        raise InputError.at(path, line, column, f"'{text}' is not allowed; give {what}")
    return value


def _names(path: Path, cells: list[tuple[int, str]], column: str | None, what: str) -> tuple[str, ...]:
    earlier: set[str] = set()
    for line, name in cells:
        if not name:
            raise InputError.at(path, line, column, f"a {what} has no name; name it")
        if "\0" in name:
            raise InputError.at(path, line, column, f"{what} {name!r} holds a NUL character; remove it")
        if any(ord(each) < 32 or 127 <= ord(each) < 160 for each in name):
            raise InputError.at(path, line, column, f"{what} {name!r} holds a control character; remove it")
        if name in earlier:
            raise InputError.at(path, line, column, f"{what} '{name}' appears twice; keep one")
        earlier.add(name)
    return tuple(name for _, name in cells)


def _table(path: Path) -> tuple[list[str], list[Row]]:
    """Header and rows with their line numbers; cells are stripped, blank lines skipped, lengths checked."""
    if path.is_dir():
        raise InputError.at(path, None, None, "is a directory; give the CSV file itself")
    if not path.exists():  # a pipe, such as the shell's <(…), will do
        raise InputError.at(path, None, None, "no such file; check the path")
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.reader(stream, strict=True)
            lines = [(reader.line_num, [cell.strip() for cell in cells]) for cells in reader]
    except (UnicodeDecodeError, csv.Error, OSError) as error:
        raise InputError.at(path, None, None, f"cannot be read as a UTF-8 CSV file ({error})") from error
    lines = [(line, cells) for line, cells in lines if any(cells)]
    if not lines:
        raise InputError.at(path, None, None, "is empty; it needs a header and one row per task")
    (first, header), *rows = lines
    if len(header) == 1:
        raise InputError.at(path, first, None, "the header has one cell only; separate the cells by commas")
    if not rows:
        raise InputError.at(path, None, None, "has a header but no tasks; add one row per task")
    if twice := [name for name, count in Counter(header).items() if name and count > 1]:
        raise InputError.at(path, 1, twice[0], "column appears twice; keep one")
    for line, cells in rows:
        if len(cells) != len(header):
            raise InputError.at(path, line, None, f"has {len(cells)} cells; the header has {len(header)}")
    return header, rows

"""A person's own tasks: a table of orders and one of transfer; what comes out is `p2l.team.plan_files`'s.

Reading stops at the first thing that is wrong, with one message that names the file, the row (as a spreadsheet counts
them) and the column. `p2l.team.sheets` says which files are tables.
"""

from __future__ import annotations

from itertools import repeat
from pathlib import Path

import numpy as np

from p2l.errors import ConfigError, InputError, ShapeError
from p2l.records import Array
from p2l.team.columns import distinct_names, known_columns, likeness, probabilities
from p2l.team.problem import ORDERS, Order, Problem
from p2l.team.sheets import STANDARD_INPUT, Sheet, number, probability, read_sheet

_COSTS = ("c_rob", "c_hum", "c_fail", "c_demo")
_NEEDED = ("task", *_COSTS)
_KNOWN = (*_NEEDED, "pretrained")
_UNUSED = ("", "-", "–", "—")  # on the diagonal of the transfer table


def read_problem(orders_csv: Path | str, transfer_csv: Path | str, order: Order = "fixed") -> Problem:
    r"""Read tasks in work order and the transfer table.

    Args:
        orders_csv: columns `task,c_rob,c_hum,c_fail,c_demo` and optionally `pretrained` (a probability, 0 if absent);
            others are not read. A cost that is `inf` or `never`, or left empty, stands for what is not possible.
        transfer_csv: square; first column the taught task, first row the tested task, cells probabilities. Rows and
            columns may come in any order, those of tasks without an order are not read, and the diagonal may be empty.
        order: "fixed" or "any".

    Raises:
        InputError: a file that is missing, empty or no table; a missing, repeated or misspelt column; a missing or
            repeated task; a cell that is no number, NaN, negative, or no probability; a task that nobody can do.
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
    if str(orders_csv) == str(transfer_csv) == STANDARD_INPUT:
        raise InputError.at("standard input", None, None, "can be read once; give a file for one of the tables")
    sheet = read_sheet(orders_csv)
    at = known_columns(sheet, _KNOWN, _NEEDED)
    tasks = distinct_names(
        sheet, [(line, cells[at["task"]]) for line, cells in sheet.rows], sheet.header[at["task"]], "task"
    )
    costs = {
        name: np.array([number(sheet, line, sheet.header[at[name]], cells[at[name]]) for line, cells in sheet.rows])
        for name in _COSTS
    }
    pretrained = np.zeros(len(tasks))
    if (place := at.get("pretrained")) is not None:
        column = sheet.header[place]
        pretrained = np.array([probability(sheet, line, column, cells[place], empty=0.0) for line, cells in sheet.rows])
    table = _transfer(read_sheet(transfer_csv), tasks, Path(sheet.name).name)
    try:
        return Problem(tasks=tasks, **costs, pretrained=pretrained, transfer=table, order=order)
    except ShapeError as error:
        raise InputError.at(sheet.name, None, None, str(error)) from error


def _transfer(sheet: Sheet, tasks: tuple[str, ...], orders: str) -> Array:
    """[n, n] of the tasks that have an order."""
    first = sheet.header_line
    tested = distinct_names(sheet, [(first, name) for name in sheet.header[1:]], None, "tested task")
    taught = distinct_names(
        sheet, [(line, cells[0]) for line, cells in sheet.rows], sheet.header[0] or None, "taught task"
    )
    for found, row, side in ((tested, first, "column"), (taught, None, "row")):
        if missing := sorted(set(tasks) - set(found), key=tasks.index):
            hint = likeness(missing[0], set(found) - set(tasks), "; add it")
            raise InputError.at(sheet.name, row, None, f"has no {side} for task '{missing[0]}' of {orders}{hint}")
    place = {name: index for index, name in enumerate(tasks)}
    used = [at for at, name in enumerate(tested) if name in place]
    names = tuple(tested[at] for at in used)
    columns = np.array([place[name] for name in names])
    own = {name: at for at, name in enumerate(names)}
    table = np.empty((len(tasks), len(tasks)))
    for (line, cells), name in zip(sheet.rows, taught, strict=True):
        if name in place:
            texts = list(cells[1:]) if len(used) == len(tested) else [cells[1 + at] for at in used]
            if texts[own[name]] in _UNUSED:
                texts[own[name]] = "1"  # no plan depends on it
            table[place[name], columns] = probabilities(sheet, zip(repeat(line), names, strict=False), texts)
    return table

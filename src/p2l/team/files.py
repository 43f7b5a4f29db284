"""A person's own tasks: `orders.csv` and `transfer.csv` in, `plan.csv`, `plan.json` and a table of reasons out.

Reading stops at the first thing that is wrong, with one message that names the file, the row (as a spreadsheet counts
them, the header is row 1) and the column.
"""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from p2l.artifacts import finite, write_text
from p2l.errors import ConfigError, InputError
from p2l.records import Array
from p2l.team.outcome import decide, objective
from p2l.team.problem import ORDERS, Decision, Order, Plan, Problem

_COSTS = ("c_rob", "c_hum", "c_fail", "c_demo")
_ORDERS_COLUMNS = ("task", *_COSTS)
_LARGEST = 1e100  # said in a message; a larger cost is a slip, and sums of such costs overflow
_NAMES = 4  # tasks that a row of the table of reasons names; the rest are counted

Row = tuple[int, list[str]]


def read_problem(orders_csv: Path | str, transfer_csv: Path | str, order: Order = "fixed") -> Problem:
    r"""Read tasks in work order and the transfer table.

    Args:
        orders_csv: columns `task,c_rob,c_hum,c_fail,c_demo` and optionally `pretrained` (a probability, 0 if absent).
        transfer_csv: square; first column the taught task, first row the tested task, cells probabilities. Rows and
            columns may come in any order.
        order: "fixed" or "any".

    Raises:
        InputError: a file that is missing, empty or not a CSV; an unknown, missing or repeated column; a missing, extra
            or repeated task; a cell that is no number, NaN, infinite, negative, or no probability.
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
    return Problem(tasks=tasks, **costs, pretrained=pretrained, transfer=table, order=order)


def write_plan(folder: Path | str, problem: Problem, plan: Plan) -> None:
    """Write `plan.csv` (one row per task, in order of work) and `plan.json` (the summary) into `folder`, atomically.

    In `plan.csv`, `skill` names the lesson that an attempt uses (a taught task names itself); it is empty for the
    pre-trained skills and for the person.

    Example:
        >>> import numpy as np
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from p2l import Problem, plan, write_plan
        >>> one = np.ones(1)
        >>> problem = Problem(("gear",), 10 * one, 100 * one, 100 * one, 200 * one, 0.95 * one, np.eye(1))
        >>> with TemporaryDirectory() as folder:
        ...     write_plan(folder, problem, plan(problem))
        ...     print((Path(folder) / "plan.csv").read_text(), end="")
        order,task,decision,skill,p_success,expected_cost
        1,gear,act,,0.95,15
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["order", "task", "decision", "skill", "p_success", "expected_cost"])
    for place, task in enumerate(plan.sequence.tolist(), start=1):
        skill = int(plan.skill[task])
        decision = Decision(int(plan.decision[task])).name.lower()
        numbers = [f"{value:.12g}" for value in (plan.p_success[task], plan.expected_cost[task])]
        writer.writerow([place, problem.tasks[task], decision, problem.tasks[skill] if skill >= 0 else "", *numbers])
    summary = {
        "planner": plan.planner,
        "status": plan.status,
        "objective": finite(plan.objective),
        "lower_bound": finite(plan.lower_bound),
        "gap": finite(plan.gap),
        "seconds": finite(plan.seconds),
        "n_tasks": problem.n,
        "n_act": plan.count(Decision.ACT),
        "n_delegate": plan.count(Decision.DELEGATE),
        "n_learn": plan.count(Decision.LEARN),
    }
    facts = json.dumps(summary, indent=1, allow_nan=False) + "\n"
    write_text(Path(folder) / "plan.csv", text.getvalue())
    write_text(Path(folder) / "plan.json", facts)


def explain(problem: Problem, plan: Plan) -> str:
    """A table saying why each lesson pays: its cost, the tasks it pays for, their cost without it, and the saving.

    "Without it" keeps the other lessons and does every other task at its best; the taught task is counted in.

    Example:
        >>> import numpy as np
        >>> from p2l import Problem, explain, plan
        >>> one = np.ones(1)
        >>> problem = Problem(("gear",), 10 * one, 100 * one, 100 * one, 200 * one, 0.95 * one, np.eye(1))
        >>> print(explain(problem, plan(problem)))  # doctest: +ELLIPSIS
        Expected cost 15.0 (proven optimal)...
    """
    lessons = plan.decision == Decision.LEARN
    alone = objective(problem, decide(problem, np.zeros(problem.n, dtype=bool), plan.sequence), plan.sequence).total
    rows = [("lesson", "costs", "pays for", "cost without it", "cost with it", "saving")]
    for lesson in plan.sequence[lessons[plan.sequence]].tolist():
        others = lessons.copy()
        others[lesson] = False
        without = objective(problem, decide(problem, others, plan.sequence), plan.sequence).expected_cost
        users = [task for task in plan.sequence.tolist() if plan.skill[task] == lesson and task != lesson]
        group = [lesson, *users]
        before, now = float(without[group].sum()), float(plan.expected_cost[group].sum())
        names = [problem.tasks[task] for task in users]
        listing = ", ".join(names[:_NAMES]) + (f" and {len(names) - _NAMES} more" if len(names) > _NAMES else "")
        numbers = [f"{value:,.1f}" for value in (before, now, before - now)]
        rows.append((problem.tasks[lesson], f"{problem.c_demo[lesson]:,.1f}", listing or "itself only", *numbers))
    counts = ", ".join(f"{plan.count(kind)} {kind.name.lower()}" for kind in Decision)
    total = f"Expected cost {plan.objective:,.1f} ({_proof(plan)}); without any lesson {alone:,.1f}. {counts}."
    return total + "\n" + (_columns(rows) if len(rows) > 1 else "No lesson pays for itself.")


def _proof(plan: Plan) -> str:
    """How far the plan can be from the best one; `plan.gap` is relative to the plan, so it would say too little."""
    if plan.status == "optimal":
        return "proven optimal"
    if plan.lower_bound > 0.0:
        excess = (plan.objective - plan.lower_bound) / plan.lower_bound
        return f"{plan.status}, at most {excess:.2%} above the optimum"
    return f"{plan.status}, the optimum is at least {max(0.0, plan.lower_bound):,.1f}"  # no cost is negative


def _columns(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    names = (0, 2)  # read from the left; numbers are compared from the right
    lines = [
        "  ".join(
            cell.ljust(w) if column in names else cell.rjust(w)
            for column, (cell, w) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    ]
    return "\n".join([lines[0], "  ".join("-" * width for width in widths), *lines[1:]])


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
    what = "a probability in [0, 1]" if largest == 1.0 else "a cost of at least 0 and at most 1e100"
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
        if name in earlier:
            raise InputError.at(path, line, column, f"{what} '{name}' appears twice; keep one")
        earlier.add(name)
    return tuple(name for _, name in cells)


def _table(path: Path) -> tuple[list[str], list[Row]]:
    """Header and rows with their line numbers; cells are stripped, blank lines skipped, lengths checked."""
    if path.is_dir():
        raise InputError.at(path, None, None, "is a directory; give the CSV file itself")
    if not path.is_file():
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

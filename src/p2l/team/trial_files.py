"""A person's `features.csv`, `trials.csv` and orders, as records. What comes out is `p2l.team.transfer_files`'s."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from p2l.errors import InputError, ShapeError
from p2l.records import IntArray
from p2l.team.costs import LARGEST
from p2l.team.problem import Order, Problem
from p2l.transfer.few_trials import TaskTable, Trials

_COUNTS, _SINGLE = ("successes", "attempts"), ("success",)
_YES, _NO = ("1", "yes", "true"), ("0", "no", "false")
_COSTS = ("c_rob", "c_hum", "c_fail", "c_demo")
_MOST_ATTEMPTS = 10_000  # of one row; more is a slip


@dataclass(frozen=True)
class Table:
    """A header and rows of cells, with the line of each row as a spreadsheet counts them."""

    path: Path
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]

    def column(self, name: str) -> list[tuple[int, str]]:
        """Lines and cells of a column."""
        at = self.header.index(name)
        return [(line, row[at]) for line, row in zip(self.lines, self.rows, strict=True)]


def read_table(path: Path, columns: Sequence[str]) -> Table:
    """A CSV in UTF-8 with commas that has at least `columns`. The one place where this module opens a person's file.

    Raises:
        InputError: missing, no CSV, no rows, a row of another length, a column that is missing or twice.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.reader(stream, strict=True)
            lines = [(reader.line_num, tuple(cell.strip() for cell in cells)) for cells in reader]
    except (UnicodeDecodeError, csv.Error, OSError) as error:
        raise InputError.at(path, None, None, f"cannot be read as a UTF-8 CSV file ({error})") from error
    lines = [(line, cells) for line, cells in lines if any(cells)]
    if len(lines) < 2:
        raise InputError.at(path, None, None, "is empty; it needs a header and at least one row")
    (first, header), *rows = lines
    for name in columns:
        if name not in header:
            raise InputError.at(path, first, name, f"column is missing; the header has {', '.join(header)}")
    for name in header:
        if not name or header.count(name) > 1:
            raise InputError.at(path, first, name, "column appears twice or has no name; give each its own")
    for line, cells in rows:
        if len(cells) != len(header):
            raise InputError.at(path, line, None, f"has {len(cells)} cells; the header has {len(header)}")
    return Table(path, header, tuple(cells for _, cells in rows), tuple(line for line, _ in rows))


def read_features(path: Path) -> TaskTable:
    """Tasks and their features: column `task`, optionally `family`, all others numbers or categories.

    A column whose cells are all numbers is numeric; one that has no number at all is a category.

    Raises:
        InputError: as `read_table`; a task without a name or twice; a column that mixes numbers and text.
    """
    table = read_table(path, ("task",))
    names: dict[str, int] = {}
    for line, name in table.column("task"):
        if not name or name in names:
            what = f"task '{name}' appears twice; keep one" if name else "a task has no name; name it"
            raise InputError.at(path, line, "task", what)
        names[name] = line
    numeric: dict[str, list[float]] = {}
    categories: dict[str, list[str]] = {}
    for column in (name for name in table.header if name not in ("task", "family")):
        cells = table.column(column)
        values = [_finite(cell) for _, cell in cells]
        if all(value is None for value in values) and all(cell for _, cell in cells):
            categories[column] = [cell for _, cell in cells]
            continue
        for (line, cell), value in zip(cells, values, strict=True):
            if value is None:
                what = f"'{cell}' is not a number, and other rows have numbers here" if cell else "is empty"
                raise InputError.at(path, line, column, f"{what}; give every task a number, or every task a word")
        numeric[column] = [value for value in values if value is not None]
    family = None
    if "family" in table.header:
        cells = table.column("family")
        if empty := [line for line, cell in cells if not cell]:
            raise InputError.at(path, empty[0], "family", "is empty; name a family, or leave the column out")
        family = _codes([cell for _, cell in cells])
    if not numeric and not categories and family is None:
        raise InputError.at(path, None, None, "has no features; add a column of numbers or words, or 'family'")
    m = len(names)
    return TaskTable(
        names=tuple(names),
        numeric_names=tuple(numeric),
        numeric=np.array(list(numeric.values()), dtype=np.float64).reshape(len(numeric), m).T,
        category_names=tuple(categories),
        category=np.array([_codes(each) for each in categories.values()], dtype=np.int64).reshape(-1, m).T,
        family=family,
    )


def read_trials(path: Path, names: Sequence[str], features: Path) -> Trials:
    """Trials as `taught,tested,successes,attempts`, or one per row as `taught,tested,success`; pairs are pooled.

    Args:
        path: the file.
        names: tasks that have features.
        features: their file, for messages.

    Raises:
        InputError: as `read_table`; other columns; an unknown task; counts that are none.
    """
    table = read_table(path, ("taught", "tested"))
    kinds = [kind for kind in (_COUNTS, _SINGLE) if set(table.header) == {"taught", "tested", *kind}]
    if not kinds:
        expected = "expected taught,tested,successes,attempts or taught,tested,success"
        raise InputError.at(path, 1, None, f"has columns {','.join(table.header)}; {expected}")
    place = {name: at for at, name in enumerate(names)}
    pairs = [_places(table, column, place, features) for column in ("taught", "tested")]
    if kinds[0] == _SINGLE:
        successes = [_truth(path, line, cell) for line, cell in table.column("success")]
        attempts = [1] * len(successes)
    else:
        successes, attempts = (
            [_count(path, line, name, cell, low) for line, cell in table.column(name)]
            for name, low in (("successes", 0), ("attempts", 1))
        )
        for line, wins, total in zip(table.lines, successes, attempts, strict=True):
            if wins > total:
                raise InputError.at(path, line, "successes", f"{wins} of {total} attempts; there cannot be more")
    return Trials.pooled(pairs[0], pairs[1], np.array(successes), np.array(attempts))


def read_orders(path: Path, names: Sequence[str], features: Path, order: Order) -> tuple[Problem, IntArray]:
    """A day's orders without a transfer table, and the task [n] behind each of its rows.

    Columns `task,c_rob,c_hum,c_fail,c_demo`, optionally `pretrained` and `count` (how often the task comes; further
    copies are rows of their own). Other columns are not read.

    Raises:
        InputError: as `read_table`; a task without features or twice; no cost, probability or count where one is due.
    """
    table = read_table(path, ("task", *_COSTS))
    place = {name: at for at, name in enumerate(names)}
    tasks = _places(table, "task", place, features)
    if len(set(tasks.tolist())) < len(tasks):
        twice = next(at for at, task in enumerate(tasks) if task in tasks[:at])
        raise InputError.at(path, table.lines[twice], "task", "appears twice; keep one, and say how often in 'count'")
    counts = [_count(path, line, "count", cell, 1) for line, cell in table.column("count")] if (
        "count" in table.header
    ) else [1] * len(tasks)  # fmt: skip
    rows = np.repeat(np.arange(len(tasks)), counts)
    if len(rows) > _MOST_ATTEMPTS:
        raise InputError.at(path, None, "count", f"{len(rows)} tasks in all; at most {_MOST_ATTEMPTS}")
    copy = np.concatenate([np.arange(count) for count in counts])
    labels = [
        f"{names[tasks[row]]} ({nth + 1})" if nth else names[tasks[row]] for row, nth in zip(rows, copy, strict=True)
    ]
    costs = {
        name: np.array([_cost(path, line, name, cell) for line, cell in table.column(name)])[rows] for name in _COSTS
    }
    pretrained = np.zeros(len(tasks))
    if "pretrained" in table.header:
        pretrained = np.array([_share(path, line, cell) for line, cell in table.column("pretrained")])
    try:
        problem = Problem(
            tasks=tuple(labels), **costs, pretrained=pretrained[rows], transfer=np.ones((len(rows),) * 2), order=order
        )
    except ShapeError as error:
        raise InputError.at(path, None, None, str(error)) from error
    return problem, tasks[rows]


def _places(table: Table, column: str, place: Mapping[str, int], features: Path) -> IntArray:
    """Task index of each row of a column of names."""
    found = []
    for line, name in table.column(column):
        if name not in place:
            raise InputError.at(table.path, line, column, f"task '{name}' is not in {features.name}; add its features")
        found.append(place[name])
    return np.array(found, dtype=np.int64)


def _codes(cells: Sequence[str]) -> IntArray:
    return np.unique(np.array(cells), return_inverse=True)[1].astype(np.int64)


def _finite(text: str) -> float | None:
    try:
        value = float(text.replace("_", "?"))  # Python would read 1_0 as 10
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _truth(path: Path, line: int, text: str) -> int:
    if text.lower() not in (*_YES, *_NO):
        raise InputError.at(path, line, "success", f"'{text}' is neither; give 1 or 0, yes or no, true or false")
    return int(text.lower() in _YES)


def _count(path: Path, line: int, column: str, text: str, low: int) -> int:
    if not text.isascii() or not text.isdigit() or not low <= int(text) <= _MOST_ATTEMPTS:
        raise InputError.at(
            path, line, column, f"'{text}' is not allowed; give a whole number from {low} to {_MOST_ATTEMPTS}"
        )
    return int(text)


def _cost(path: Path, line: int, column: str, text: str) -> float:
    if text.lower() in ("", "inf", "infinity"):
        return math.inf
    value = _finite(text)
    if value is None or not 0.0 <= value <= LARGEST:
        raise InputError.at(path, line, column, f"'{text}' is not allowed; give a cost of at least 0, or inf for never")
    return value


def _share(path: Path, line: int, text: str) -> float:
    value = _finite(text)
    if value is None or not 0.0 <= value <= 1.0:
        raise InputError.at(path, line, "pretrained", f"'{text}' is not allowed; give a probability in [0, 1]")
    return value

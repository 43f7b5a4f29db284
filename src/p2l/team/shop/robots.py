"""Several robots: what each of them does otherwise than the table of orders says, and the arcs of a partial order."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from p2l.errors import InputError
from p2l.records import Array, BoolArray, IntArray
from p2l.team.columns import check_name, known_columns, likeness
from p2l.team.sheets import Sheet, flag, number, probability
from p2l.team.shop.orders import Orders, listed

_ATTEMPT = ("c_rob", "c_fail", "pretrained", "skill")  # they mean nothing where a lesson is none of today's tasks
_VALUES = (*_ATTEMPT, "c_demo", "teachable")
_KNOWN = ("robot", "task", *_VALUES)
_Cells = list[tuple[int, int, tuple[str, ...]]]  # robot, line, row


@dataclass(frozen=True)
class Robots:
    """R robots at n tasks, and at K lessons: n on the tasks, then those of the transfer table that are on none.

    Attributes:
        names: R names.
        c_rob: [R, n] as in `Shop`.
        c_fail: [R, n] as in `Shop`.
        pretrained: [R, n] as in `Shop`.
        skill: [R, n] factor of every transfer probability.
        c_demo: [R, K] cost of one demonstration; NaN where nobody says it.
        teachable: [R, K] whether a lesson can be given at all.
        remarks: what was assumed.
    """

    names: tuple[str, ...]
    c_rob: Array
    c_fail: Array
    pretrained: Array
    skill: Array
    c_demo: Array
    teachable: BoolArray
    remarks: tuple[str, ...]


def read_robots(sheet: Sheet | None, orders: Orders, lessons: Mapping[str, float]) -> Robots:
    """The robots, the orders' values replaced by what a table says of each of them.

    Args:
        sheet: columns `robot`, optionally `task` (empty for all), and any of `c_rob,c_fail,c_demo,pretrained,
            teachable,skill`; an empty cell replaces nothing. A row with a task wins over one without, which does not
            make possible what the orders rule out (an infinite cost, `teachable=no`). None stands for one robot, as
            the orders say.
        orders: of today.
        lessons: cost of a demonstration of each lesson that is on no task, NaN where it is not known.

    Raises:
        InputError: a misspelt column, an unknown task, a robot whose values are given twice, a cell that does not hold
            what it should.
    """
    tasks = (*orders.tasks, *lessons)
    n, k = len(orders.tasks), len(tasks)
    names: tuple[str, ...] = ("robot",)
    at: dict[str, int] = {}
    rows: _Cells = []
    if sheet is not None:
        at = known_columns(sheet, _KNOWN, ("robot",), "row")
        names, rows = _robots(sheet, at["robot"])
    table: dict[str, Array] = {
        "c_rob": orders.c_rob,
        "c_fail": orders.c_fail,
        "pretrained": orders.pretrained,
        "skill": np.ones(n),
        "c_demo": np.concatenate([orders.c_demo, list(lessons.values())]),
        "teachable": np.concatenate([orders.teachable, np.ones(len(lessons))]),
    }
    values = {
        name: np.repeat(np.asarray(of_all, dtype=np.float64)[None], len(names), 0) for name, of_all in table.items()
    }
    if sheet is not None:
        _replace(sheet, at, rows, values, {name: place for place, name in enumerate(tasks)}, n)
    others = [] if sheet is None else list(sheet.extra(_KNOWN))
    remarks = (f"not read in {sheet.name}: {listed(others)}",) if sheet is not None and others else ()
    assert values["c_demo"].shape == (len(names), k)
    teachable = values.pop("teachable") > 0.0
    return Robots(names=names, **values, teachable=teachable, remarks=remarks)


def _robots(sheet: Sheet, place: int) -> tuple[tuple[str, ...], _Cells]:
    names: dict[str, int] = {}
    rows: _Cells = []
    for line, cells in sheet.rows:
        check_name(sheet, line, sheet.header[place], "robot", cells[place])
        rows.append((names.setdefault(cells[place], len(names)), line, cells))
    if not names:
        raise InputError.at(sheet.name, None, None, "has a header but no robots; add one row per robot")
    return tuple(names), rows


def _replace(
    sheet: Sheet, at: Mapping[str, int], rows: _Cells, values: Mapping[str, Array], place: Mapping[str, int], n: int
) -> None:
    """Write into `values` what rows without a task say, then what those with one say."""
    read: dict[str, Callable[[int, str, str], float]] = {
        **dict.fromkeys(("c_rob", "c_fail", "c_demo"), lambda *cell: number(sheet, *cell)),
        **dict.fromkeys(("pretrained", "skill"), lambda *cell: probability(sheet, *cell)),
        "teachable": lambda *cell: flag(sheet, *cell),
    }
    earlier: dict[tuple[int, str], int] = {}
    task = [cells[at["task"]] if "task" in at else "" for _, _, cells in rows]
    for (robot, line, cells), name in sorted(zip(rows, task, strict=True), key=lambda row: row[1] != ""):
        if (robot, name) in earlier:
            what = f"with task '{name}'" if name else "without a task"
            problem = f"robot '{cells[at['robot']]}' {what} is in row {earlier[robot, name]}, too; keep one"
            raise InputError.at(sheet.name, line, sheet.header[at["robot"]], problem)
        earlier[robot, name] = line
        if name and name not in place:
            problem = f"'{name}' is no task of the orders{likeness(name, place, '; leave it empty for all tasks')}"
            raise InputError.at(sheet.name, line, sheet.header[at["task"]], problem)
        for what in (each for each in _VALUES if each in at and cells[at[each]]):
            column = sheet.header[at[what]]
            value = read[what](line, column, cells[at[what]])
            if name and what in _ATTEMPT and place[name] >= n:
                problem = f"'{name}' is a lesson and no task of the orders; only c_demo and teachable are of it"
                raise InputError.at(sheet.name, line, column, problem)
            target = values[what][robot]
            if name:
                target[place[name]] = value
            else:
                target[_open(what, target)] = value


def _open(what: str, values: Array) -> BoolArray:
    """Tasks for which a row without a task may say something: what the orders rule out takes a row of its own.

    A lesson whose cost nobody knows stays one, too, or a large catalogue would come in with a robot.
    """
    if what == "teachable":
        return np.asarray(values > 0.0)
    return np.isfinite(values)


def read_before(sheet: Sheet, tasks: tuple[str, ...]) -> IntArray:
    """[P, 2] arcs of a partial order.

    Args:
        sheet: columns `before` and `after`, a task in each cell.
        tasks: n names.

    Raises:
        InputError: a misspelt column, an unknown task, a task before itself, rows that go in a circle.
    """
    at = known_columns(sheet, ("before", "after"), ("before", "after"), "row")
    place = {name: index for index, name in enumerate(tasks)}
    arcs: dict[tuple[int, int], int] = {}
    for line, cells in sheet.rows:
        for column in ("before", "after"):
            name = cells[at[column]]
            check_name(sheet, line, sheet.header[at[column]], "task", name)
            if name not in place:
                problem = f"'{name}' is no task of the orders{likeness(name, tasks, '; take the row out')}"
                raise InputError.at(sheet.name, line, sheet.header[at[column]], problem)
        first, second = (place[cells[at[column]]] for column in ("before", "after"))
        if first == second:
            raise InputError.at(sheet.name, line, None, f"task '{tasks[first]}' is before itself; take the row out")
        arcs.setdefault((first, second), line)
    _refuse_circle(sheet, arcs, tasks)
    return np.array(list(arcs), dtype=np.int64).reshape(-1, 2)


def _refuse_circle(sheet: Sheet, arcs: Mapping[tuple[int, int], int], tasks: tuple[str, ...]) -> None:
    """Take away tasks before which nothing is left; each of the others has one before it, back to a circle."""
    following: dict[int, list[int]] = {}
    waiting = dict.fromkeys(range(len(tasks)), 0)
    for first, second in arcs:
        following.setdefault(first, []).append(second)
        waiting[second] += 1
    free = [task for task, many in waiting.items() if many == 0]
    while free:
        done = free.pop()
        del waiting[done]
        for task in following.get(done, []):
            waiting[task] -= 1
            if waiting[task] == 0:
                free.append(task)
    if not waiting:
        return
    before = {second: first for first, second in arcs if first in waiting and second in waiting}
    way = [next(iter(waiting))]
    while way.count(way[-1]) == 1:
        way.append(before[way[-1]])
    circle = way[way.index(way[-1]) :][::-1]
    lines = sorted(arcs[arc] for arc in pairwise(circle))
    names = " before ".join(f"'{tasks[each]}'" for each in circle)
    rows = ", ".join(map(str, lines))
    raise InputError.at(sheet.name, lines[0], None, f"rows {rows} go in a circle: {names}; take one of them out")

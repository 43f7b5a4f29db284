"""Probabilities of a transfer table: square, lessons by tasks, or a row per pair; with gaps, and for several robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import repeat

import numpy as np

from p2l.errors import InputError
from p2l.records import Array, BoolArray, IntArray
from p2l.team.columns import likeness, probabilities
from p2l.team.sheets import Sheet, number, whole_number
from p2l.team.shop.lessons import COUNTS, TransferTable, as_ordered, names_of

_DIGITS = 9  # of a number of trials
ABSENT = frozenset(("", "-", "–", "—", "na", "n/a", "#n/a"))


@dataclass(frozen=True)
class Measured:
    """What a table says of L lessons and n tasks; NaN where it says nothing.

    Attributes:
        general: [L, n] of any robot.
        own: [L, n] of the robots that have rows of their own.
        remarks: what was assumed.
        trials: [L, n] attempts behind the general ones, 0 where nobody has counted any.
        own_trials: [L, n] of the robots that have rows of their own.
    """

    general: Array
    own: Mapping[int, Array]
    remarks: tuple[str, ...]
    trials: Array
    own_trials: Mapping[int, Array]


def read_probabilities(
    table: TransferTable, lessons: tuple[str, ...], tasks: tuple[str, ...], robots: tuple[str, ...]
) -> Measured:
    """The probabilities of lessons that can be given on today's tasks; other cells are not looked at.

    Args:
        table: of transfer.
        lessons: L names.
        tasks: n names.
        robots: R names.

    Raises:
        InputError: a cell that is no probability; a robot that is none of `robots`.
    """
    if table.sheet is None:
        shape = len(lessons), len(tasks)
        return Measured(np.full(shape, np.nan), {}, (), np.zeros(shape), {})
    if "taught" in table.at:
        return _long(table, table.sheet, lessons, tasks, robots)
    values = _wide(table, table.sheet, lessons, tasks)
    return Measured(values, {}, (), np.zeros(values.shape), {})


def _wide(table: TransferTable, sheet: Sheet, lessons: tuple[str, ...], tasks: tuple[str, ...]) -> Array:
    values = np.full((len(lessons), len(tasks)), np.nan)
    place = {name: at for at, name in enumerate(tasks)}
    known = as_ordered(sheet.header, tasks)
    tested = {known[name]: at for at, name in enumerate(sheet.header) if at not in (0, table.at.get("c_demo"))}
    names = [name for name in tested if name in place]
    columns, used = np.array([place[name] for name in names]), [tested[name] for name in names]
    own, of_lesson = {name: at for at, name in enumerate(names)}, {name: at for at, name in enumerate(lessons)}
    for (line, cells), name in zip(sheet.rows, table.taught, strict=True):
        if name in of_lesson:
            texts = [cells[at] for at in used]
            is_open = name in own and texts[own[name]].casefold() in ABSENT
            if is_open:  # a usual gap, and no reason to look at each cell
                texts[own[name]] = "0"
            values[of_lesson[name], columns] = probabilities(
                sheet, zip(repeat(line), names, strict=False), texts, ABSENT
            )
            if is_open:
                values[of_lesson[name], place[name]] = np.nan
    return values


def _long(
    table: TransferTable, sheet: Sheet, lessons: tuple[str, ...], tasks: tuple[str, ...], robots: tuple[str, ...]
) -> Measured:
    """Measurements of one pair are pooled: the mean of p, by `n`, or all successes by all attempts."""
    at = table.at
    tested = names_of(sheet, at["tested"], "tested task", tasks)
    if tested and not set(tested) & set(tasks):
        column = sheet.header[at["tested"]]
        raise InputError.at(sheet.name, None, column, "no row is for a task of the orders; give one for each pair")
    of_lesson, of_task = ({name: k for k, name in enumerate(names)} for names in (lessons, tasks))
    used = [
        row
        for row, pair in enumerate(zip(table.taught, tested, strict=True))
        if pair[0] in of_lesson and pair[1] in of_task
    ]
    robot = _robots(sheet, at.get("robot"), used, robots)
    pair = np.array([of_lesson[table.taught[row]] * len(tasks) + of_task[tested[row]] for row in used], dtype=np.int64)
    share, weight = _measurements(sheet, at, used)
    attempts = _attempts(sheet, at, used, weight)
    is_known = ~np.isnan(share) & (weight > 0.0)
    remarks: list[str] = []
    means: dict[int, Array] = {}
    trials: dict[int, Array] = {}
    for each in sorted({-1, *map(int, robot)}):
        mine = is_known & (robot == each)
        means[each], is_pooled = _pooled(pair[mine], share[mine], weight[mine], len(lessons) * len(tasks))
        trials[each] = np.bincount(pair[mine], attempts[mine], len(lessons) * len(tasks)).astype(np.float64)
        if is_pooled.any():
            whose = f" of robot '{robots[each]}'" if each >= 0 else ""
            how = ", weighted by n" if "n" in at else ", all successes by all attempts" if "p" not in at else ""
            remarks.append(
                f"{is_pooled.sum()} of the pairs{whose} are in {table.name} more than once; their mean is taken{how}"
            )
    shape = len(lessons), len(tasks)
    shaped, counts = ({each: row.reshape(shape) for each, row in rows.items()} for rows in (means, trials))
    return Measured(shaped.pop(-1), shaped, tuple(remarks), counts.pop(-1), counts)


def _attempts(sheet: Sheet, at: Mapping[str, int], used: Sequence[int], weight: Array) -> Array:
    """Attempts behind each row: `n`, or all that were counted, or whole numbers in `predict_transfer`'s `trials`."""
    if "p" not in at or "n" in at:
        return weight
    if not (place := sheet.columns(("trials",))):
        return np.zeros(len(used))
    cells = [sheet.rows[row][1][place["trials"]] for row in used]  # a column that may be a person's own
    return np.array([float(cell) if cell.isdecimal() and len(cell) <= _DIGITS else 0.0 for cell in cells])


def _robots(sheet: Sheet, place: int | None, used: Sequence[int], robots: tuple[str, ...]) -> IntArray:
    """Robot of each row, -1 for all of them."""
    of = {"": -1, **{name: each for each, name in enumerate(robots)}}
    found = np.full(len(used), -1, dtype=np.int64)
    if place is None:
        return found
    for row, (line, cells) in enumerate(sheet.rows[each] for each in used):
        if (name := cells[place]) not in of:
            problem = f"'{name}' is no robot{likeness(name, robots, '; give it a row in a table of robots')}"
            raise InputError.at(sheet.name, line, sheet.header[place], problem)
        found[row] = of[name]
    return found


def _measurements(sheet: Sheet, at: Mapping[str, int], used: Sequence[int]) -> tuple[Array, Array]:
    """p, NaN if not known, and weight of each row."""
    rows = [sheet.rows[row] for row in used]
    if "p" in at:
        place = at["p"]
        column = sheet.header[place]
        places = ((line, column) for line, _ in rows)
        share = probabilities(sheet, places, [cells[place] for _, cells in rows], ABSENT)
        if "n" not in at:
            return share, np.ones(len(rows))
        place, column = at["n"], sheet.header[at["n"]]
        weights = [number(sheet, line, column, cells[place], never=False, empty=1.0) for line, cells in rows]
        return share, np.array(weights, dtype=np.float64)
    good, all_of = (at[name] for name in COUNTS)
    share, weight = np.full(len(rows), np.nan), np.zeros(len(rows))
    for row, (line, cells) in enumerate(rows):
        if cells[good].casefold() in ABSENT and cells[all_of].casefold() in (*ABSENT, "0"):
            continue
        successes = whole_number(sheet, line, sheet.header[good], cells[good])
        attempts = whole_number(sheet, line, sheet.header[all_of], cells[all_of])
        if successes > attempts:
            problem = f"{successes} successes of {attempts} attempts; give at most as many"
            raise InputError.at(sheet.name, line, sheet.header[good], problem)
        if attempts:
            share[row], weight[row] = successes / attempts, attempts
    return share, weight


def _pooled(pair: IntArray, share: Array, weight: Array, pairs: int) -> tuple[Array, BoolArray]:
    """[pairs] mean, NaN where there is none, and whether it is of several rows."""
    rows, weights = np.bincount(pair, minlength=pairs), np.bincount(pair, weight, minlength=pairs)
    sums = np.bincount(pair, weight * share, minlength=pairs)
    mean = np.full(pairs, np.nan)
    np.divide(sums, weights, out=mean, where=weights > 0.0)
    mean = np.minimum(mean, 1.0)
    alone = rows[pair] == 1
    mean[pair[alone]] = share[alone]  # to the bit
    return mean, rows > 1

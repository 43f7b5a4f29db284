"""What may come tomorrow as a person has it: a table of scenarios, or expected numbers with a distribution."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np

from p2l.errors import InputError
from p2l.records import Array
from p2l.team.cells import normal, quoted
from p2l.team.columns import check_name, distinct_names, known_columns, likeness
from p2l.team.sheets import Sheet, number, probability, whole_number
from p2l.team.shop.lessons import as_ordered
from p2l.team.shop.orders import listed
from p2l.team.tomorrow.forecast import DISTRIBUTIONS, MOST, Distribution, Forecast

_SCENARIO = ("scenario", "task", "count", "probability")
_MOST_COPIES = 1_000_000
_SUM = 1e-6  # by how much probabilities that are written may miss one
_CHANCE = re.compile(r"p_?(\d{1,3})")


@dataclass(frozen=True)
class Scenarios:
    """A table of S scenarios.

    Attributes:
        names: S names.
        counts: [S, J] copies of each type.
        probability: [S] above 0; they sum to one.
        remarks: what was assumed.
    """

    names: tuple[str, ...]
    counts: Array
    probability: Array
    remarks: tuple[str, ...]


def read_scenarios(sheet: Sheet, types: tuple[str, ...]) -> Scenarios:
    """Read a row per scenario and type.

    Args:
        sheet: columns `scenario,task,count`, optionally `probability`, alike in all rows of a scenario where it is
            given; equal ones without it. A type without a row does not come; a count of 0 is a row that says so.
        types: J names of tasks that may come.

    Raises:
        InputError: an unknown task, a row that comes twice, a count that is none, probabilities of a scenario that
            differ, that are missing, or that do not sum to one.
    """
    at = known_columns(sheet, _SCENARIO, _SCENARIO[:3], "row")
    known = as_ordered((cells[at["task"]] for _, cells in sheet.rows), types)
    place = {name: index for index, name in enumerate(types)}
    rows: dict[str, int] = {}
    earlier: dict[tuple[int, int], int] = {}
    entries: list[tuple[int, int, int]] = []
    for line, cells in sheet.rows:
        for what in ("scenario", "task"):
            check_name(sheet, line, sheet.header[at[what]], what, cells[at[what]])
        scenario = rows.setdefault(cells[at["scenario"]], len(rows))
        kind = _kind(sheet, line, sheet.header[at["task"]], known[cells[at["task"]]], place)
        if (first := earlier.setdefault((scenario, kind), line)) != line:
            problem = f"'{types[kind]}' is in row {first} of this scenario, too; keep one"
            raise InputError.at(sheet.name, line, sheet.header[at["task"]], problem)
        column = sheet.header[at["count"]]
        entries.append((scenario, kind, whole_number(sheet, line, column, cells[at["count"]], largest=_MOST_COPIES)))
    if not rows:
        raise InputError.at(sheet.name, None, None, "has a header but no scenarios; add a row per scenario and task")
    counts = np.zeros((len(rows), len(types)))
    for scenario, kind, count in entries:
        counts[scenario, kind] = count
    chance = _chances(sheet, at, rows)
    possible = chance > 0.0
    others = sheet.extra(_SCENARIO)
    remarks: tuple[str, ...] = (f"not read in {sheet.name}: {listed(list(others))}",) if others else ()
    if not possible.all():
        remarks += (f"scenarios of probability 0 are left out ({(~possible).sum()} of {len(rows)})",)
    names = tuple(name for name, keep in zip(rows, possible.tolist(), strict=True) if keep)
    return Scenarios(names, counts[possible], chance[possible] / chance.sum(), remarks)


def _chances(sheet: Sheet, at: Mapping[str, int], rows: Mapping[str, int]) -> Array:
    """[S] probability of each scenario."""
    place = at.get("probability")
    if place is None or not any(cells[place] for _, cells in sheet.rows):
        return np.full(len(rows), 1.0 / len(rows))
    column = sheet.header[place]
    given = np.full(len(rows), math.nan)
    last = dict.fromkeys(rows, 0)
    for line, cells in sheet.rows:
        name = cells[at["scenario"]]
        last[name] = line
        if not cells[place]:
            continue
        value, row = probability(sheet, line, column, cells[place]), rows[name]
        if not math.isnan(given[row]) and given[row] != value:
            problem = f"{quoted(cells[place])} for scenario '{name}', which has {given[row]:g} in an earlier row"
            raise InputError.at(sheet.name, line, column, f"{problem}; write it alike, or once")
        given[row] = value
    for name, row in rows.items():
        if math.isnan(given[row]):
            problem = f"scenario '{name}' has no probability; give it to one of its rows, or leave out the column"
            raise InputError.at(sheet.name, last[name], column, problem)
    if abs((total := math.fsum(given.tolist())) - 1.0) > _SUM:
        problem = f"the probabilities of the {len(rows)} scenarios sum to {total:.6g}; expected 1"
        raise InputError.at(sheet.name, sheet.rows[-1][0], column, problem)
    return given


def read_forecast(sheet: Sheet, types: tuple[str, ...]) -> Forecast:
    """Read a row per type; types without a row do not come.

    Args:
        sheet: columns `task,mean`, optionally `distribution` (poisson if it is empty, fixed, geometric); or, in place
            of the mean, `p0,p1,p2,…`: the probability of none, of one, of two.
        types: J names of tasks that may come.

    Raises:
        InputError: an unknown or repeated task, a mean or a probability that is none, both of them or neither,
            probabilities that do not sum to one, an unknown distribution.
    """
    chance = {name: int(found.group(1)) for name in sheet.header if (found := _CHANCE.fullmatch(normal(name)))}
    known = ("task", "mean", "distribution", *map(normal, chance))
    needed = ("task",) if chance else ("task", "mean")
    at = known_columns(sheet, known, needed, "type")
    if sorted(chance.values()) != list(range(len(chance))):
        problem = f"probabilities of {sorted(chance.values())} copies given; name the columns p0, p1, p2 and so on"
        raise InputError.at(sheet.name, sheet.header_line, next(iter(chance)), problem)
    names = as_ordered((cells[at["task"]] for _, cells in sheet.rows), types)
    column = sheet.header[at["task"]]
    distinct_names(sheet, [(line, names[cells[at["task"]]]) for line, cells in sheet.rows], column, "task")
    place = {name: index for index, name in enumerate(types)}
    means, chances = np.zeros(len(types)), np.zeros((len(types), max(1, len(chance))))
    kinds: list[Distribution] = ["poisson"] * len(types)
    order = sorted(chance, key=lambda name: chance[name])
    for line, cells in sheet.rows:
        j = _kind(sheet, line, column, names[cells[at["task"]]], place)
        if any(cells[at[normal(name)]] for name in order):
            chances[j] = _row_of_chances(sheet, at, line, cells, order)
            kinds[j], means[j] = "given", float(chances[j] @ np.arange(len(order)))
            continue
        if "mean" not in at or not cells[at["mean"]]:
            field = sheet.header[at["mean"]] if "mean" in at else None
            ways = "a mean, or probabilities p0, p1, …" if chance else "a mean"
            raise InputError.at(sheet.name, line, field, f"task '{types[j]}' has no expected number; give {ways}")
        text = cells[at["mean"]]
        means[j] = number(sheet, line, sheet.header[at["mean"]], text, largest=MOST, empty=None, never=False)
        kinds[j] = _distribution(sheet, at, line, cells, means[j])
    return Forecast(types, means, tuple(kinds), chances)


def _kind(sheet: Sheet, line: int, column: str, name: str, place: Mapping[str, int]) -> int:
    if name not in place:
        problem = (
            f"'{name}' is no task that may come{likeness(name, place, '; give it a row in tomorrow=… or take it out')}"
        )
        raise InputError.at(sheet.name, line, column, problem)
    return place[name]


def _row_of_chances(sheet: Sheet, at: Mapping[str, int], line: int, cells: tuple[str, ...], order: list[str]) -> Array:
    for name in ("mean", "distribution"):
        if name in at and cells[at[name]]:
            problem = f"{quoted(cells[at[name]])} and probabilities of numbers are given; keep one of them"
            raise InputError.at(sheet.name, line, sheet.header[at[name]], problem)
    row = np.array([probability(sheet, line, name, cells[at[normal(name)]], empty=0.0) for name in order])
    if abs((total := math.fsum(row.tolist())) - 1.0) > _SUM:
        raise InputError.at(sheet.name, line, order[-1], f"its probabilities sum to {total:.6g}; expected 1")
    return row / total


def _distribution(sheet: Sheet, at: Mapping[str, int], line: int, cells: tuple[str, ...], mean: float) -> Distribution:
    word = normal(cells[at["distribution"]]) if "distribution" in at else ""
    written = DISTRIBUTIONS[:-1]
    if word not in ("", *written):
        close = difflib.get_close_matches(word, written, n=1)
        hint = f"; is it '{close[0]}'?" if close else f"; give {', '.join(written)}, or probabilities p0, p1, …"
        text = quoted(cells[at["distribution"]])
        raise InputError.at(sheet.name, line, sheet.header[at["distribution"]], f"{text} is no distribution{hint}")
    if word == "fixed" and mean != math.floor(mean):
        raise InputError.at(
            sheet.name, line, sheet.header[at["mean"]], f"{mean:g} copies for sure cannot be; give a whole number"
        )
    return cast(Distribution, word or "poisson")

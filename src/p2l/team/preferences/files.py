"""A person's prior and answers as tables, and the orders at the cost that is believed.

`prior.csv` has a row per family (`family,mean,sd`, optionally `distribution`: lognormal, which it is by itself, or
gamma), or rows of what the cost may be (`family,cost,probability`). `answers.csv` has a row per answer
(`family,c_hum`), in the order in which they were given; it is all that is remembered from one question to the next.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from p2l.errors import ConfigError, InputError
from p2l.team.cells import LARGEST, quoted
from p2l.team.columns import check_name, known_columns, likeness
from p2l.team.preferences.belief import MOST_POINTS, after_answer, gamma_prior, listed_prior, lognormal_prior
from p2l.team.preferences.record import CostPrior, Preferences
from p2l.team.sheets import Sheet, number, probability, read_sheet
from p2l.team.shop import Shop
from p2l.team.shop.orders import KNOWN, listed

QUESTIONS, ORDERS = "questions.csv", "expected_orders.csv"
_SUMMED, _LISTED, _ANSWERS = (
    ("family", "mean", "sd", "distribution"),
    ("family", "cost", "probability"),
    ("family", "c_hum"),
)
_LAWS = {"": lognormal_prior, "lognormal": lognormal_prior, "gamma": gamma_prior}
_SUM = 1e-6  # of probabilities as people write them


@dataclass(frozen=True)
class Told:
    """What is believed, with every answer so far.

    Attributes:
        preferences: F beliefs, of the families in the order of the prior.
        asked: families that have been answered for, in that order.
        remarks: what was assumed, a sentence each.
    """

    preferences: Preferences
    asked: tuple[int, ...]
    remarks: tuple[str, ...]


def read_preferences(
    prior: Path | str, answers: Path | str | None, shop: Shop, family: Sequence[str] | None, orders: Path | str,
    *, noise: float = 0.0, points: int = 7,
) -> Told:  # fmt: skip
    """Read what is believed of the person, and what the person has said.

    Args:
        prior: table of what is believed.
        answers: table of the answers; None if there are none.
        shop: the day.
        family: [n] of each task, '' where it has none; None if the orders have no such column.
        orders: their file, for messages.
        noise: standard deviation of an answer.
        points: K of a distribution.

    Raises:
        InputError: no table; a family that the orders or the prior do not have, or that comes twice; a cost below 0;
            probabilities that do not sum to 1; an answer that is no cost, or that the prior rules out.
    """
    if family is None:
        raise InputError.at(orders, 1, "family", "column is missing; a question is about a family of tasks")
    known = [name for name in dict.fromkeys(family) if name]
    beliefs = _read_prior(read_sheet(prior), known, Path(orders).name, points)
    place = {name: at for at, name in enumerate(beliefs)}
    member = np.array([place.get(name, -1) for name in family], dtype=np.int64)
    preferences = Preferences(tuple(beliefs), tuple(beliefs.values()), member, noise)
    remarks = []
    if unasked := [name for name in known if name not in place]:
        remarks.append(f"{Path(prior).name} does not have {listed(unasked)}; their c_hum is that of the orders")
    if (never := (member >= 0) & np.isinf(shop.c_hum)).any():
        names = listed([shop.tasks[at] for at in np.flatnonzero(never)])
        remarks.append(f"the person cannot do {names} (c_hum), whatever {Path(prior).name} says of the family")
    asked: list[int] = []
    if answers is not None:
        sheet = read_sheet(answers)
        at = known_columns(sheet, _ANSWERS, _ANSWERS, each="answer")
        column = sheet.header[at["c_hum"]]
        for line, cells in sheet.rows:
            name = _family(sheet, line, at, cells, beliefs, Path(prior).name)
            if place[name] in asked and noise == 0.0:
                raise InputError.at(
                    sheet.name, line, sheet.header[at["family"]], f"'{name}' is answered twice; keep one"
                )
            said = number(sheet, line, column, cells[at["c_hum"]], empty=None, never=False)
            try:
                preferences = after_answer(preferences, place[name], said)
            except ConfigError as error:
                raise InputError.at(sheet.name, line, column, str(error)) from error
            asked.append(place[name])
    return Told(preferences, tuple(asked), tuple(remarks))


def orders_text(orders: Path | str, shop: Shop) -> str:
    """The orders with the shop's c_hum in place of theirs; every other cell as it was written.

    Raises:
        InputError: as `read_sheet`.
    """
    sheet = read_sheet(orders)
    at = sheet.columns(KNOWN)["c_hum"]
    text = io.StringIO()
    writer = csv.writer(text, delimiter=";" if sheet.decimal_comma else ",", lineterminator="\n")
    writer.writerow(sheet.header)
    for (_, cells), cost in zip(sheet.rows, shop.c_hum.tolist(), strict=True):
        amount = f"{cost:.12g}".replace(".", "," if sheet.decimal_comma else ".")
        writer.writerow([*cells[:at], amount if math.isfinite(cost) else cells[at], *cells[at + 1 :]])
    return text.getvalue()


def _read_prior(sheet: Sheet, known: Sequence[str], orders: str, points: int) -> dict[str, CostPrior]:
    has = {kind: len(sheet.columns(kind[1:])) > 0 for kind in (_SUMMED, _LISTED)}
    if has[_SUMMED] == has[_LISTED]:
        ways = "expected family,mean,sd[,distribution] or family,cost,probability"
        raise InputError.at(
            sheet.name, sheet.header_line, None, f"has columns {quoted(','.join(sheet.header))}; {ways}"
        )
    columns, needed = (_SUMMED, _SUMMED[:3]) if has[_SUMMED] else (_LISTED, _LISTED)
    at = known_columns(sheet, columns, needed, each="family")
    if not sheet.rows:
        raise InputError.at(sheet.name, None, None, "has a header but no families; add one row per family")
    names = [_family(sheet, line, at, cells, known, orders) for line, cells in sheet.rows]
    read = _summed if has[_SUMMED] else _by_cost
    return read(sheet, at, names, points)


def _family(
    sheet: Sheet, line: int, at: dict[str, int], cells: Sequence[str], known: Sequence[str] | dict[str, CostPrior],
    where: str,
) -> str:  # fmt: skip
    name, column = cells[at["family"]], sheet.header[at["family"]]
    check_name(sheet, line, column, "family", name)
    if name not in known:
        raise InputError.at(sheet.name, line, column, f"family {quoted(name)} is not in {where}{likeness(name, known)}")
    return name


def _summed(sheet: Sheet, at: dict[str, int], names: Sequence[str], points: int) -> dict[str, CostPrior]:
    beliefs: dict[str, CostPrior] = {}
    for name, (line, cells) in zip(names, sheet.rows, strict=True):
        if name in beliefs:
            raise InputError.at(
                sheet.name, line, sheet.header[at["family"]], f"family '{name}' appears twice; keep one"
            )
        values = [
            number(sheet, line, sheet.header[at[key]], cells[at[key]], empty=None, never=False)
            for key in ("mean", "sd")
        ]
        law = cells[at["distribution"]].casefold() if "distribution" in at else ""
        if law not in _LAWS:
            problem = f"{quoted(law)} is unknown; give lognormal, gamma, or nothing for lognormal"
            raise InputError.at(sheet.name, line, sheet.header[at["distribution"]], problem)
        try:
            beliefs[name] = _LAWS[law](values[0], values[1], points)
        except ConfigError as error:
            raise InputError.at(sheet.name, line, sheet.header[at["sd"]], str(error)) from error
    return beliefs


def _by_cost(sheet: Sheet, at: dict[str, int], names: Sequence[str], _: int) -> dict[str, CostPrior]:
    costs: dict[str, dict[float, float]] = {}
    first: dict[str, int] = {}
    column = sheet.header[at["probability"]]
    for name, (line, cells) in zip(names, sheet.rows, strict=True):
        cost = number(
            sheet, line, sheet.header[at["cost"]], cells[at["cost"]], largest=LARGEST, empty=None, never=False
        )
        of_family = costs.setdefault(name, {})
        first.setdefault(name, line)
        if cost in of_family:
            problem = f"family '{name}' has the cost {cost:g} twice; keep one"
            raise InputError.at(sheet.name, line, sheet.header[at["cost"]], problem)
        of_family[cost] = probability(sheet, line, column, cells[at["probability"]])
    beliefs = {}
    for name, of_family in costs.items():
        if len(of_family) > MOST_POINTS:
            problem = f"family '{name}' has {len(of_family)} costs; give at most {MOST_POINTS}"
            raise InputError.at(sheet.name, first[name], sheet.header[at["cost"]], problem)
        total = math.fsum(of_family.values())
        if abs(total - 1.0) > _SUM:
            problem = f"probabilities of family '{name}' sum to {total:.6g}; they have to sum to 1"
            raise InputError.at(sheet.name, first[name], column, problem)
        beliefs[name] = listed_prior(list(of_family), [each / total for each in of_family.values()])
    return beliefs

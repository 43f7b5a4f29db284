"""What every table of a person is checked for: columns that may be misspelt, names that come twice, missing cells."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable, Sequence
from itertools import compress

import numpy as np

from p2l.errors import InputError
from p2l.records import Array
from p2l.team.sheets import Sheet, probability

ALIKE = 0.8  # share of letters from which on a name may be meant for another


def known_columns(sheet: Sheet, known: Sequence[str], needed: Collection[str], each: str = "task") -> dict[str, int]:
    """Place of each known column that the sheet has.

    Args:
        sheet: a table.
        known: names of its columns.
        needed: those that it cannot do without.
        each: what a row is about.

    Raises:
        InputError: a column is missing, or another may be meant for it; two are the same.
    """
    at = sheet.columns(known)
    others = {name.casefold(): name for name in sheet.extra(known)}
    for name in (each for each in known if each not in at):
        if close := difflib.get_close_matches(name, list(others), n=1, cutoff=ALIKE):
            problem = f"unknown column; write '{name}' if that is meant, or else a name that is less like it"
            raise InputError.at(sheet.name, sheet.header_line, others[close[0]], problem)
        if name in needed:
            raise InputError.at(sheet.name, sheet.header_line, name, f"column is missing; every {each} needs it")
    return at


def check_name(sheet: Sheet, line: int, column: str | None, what: str, name: str) -> None:
    """Refuse an empty name, and one with control characters.

    Raises:
        InputError: it is such a name.
    """
    if not name:
        raise InputError.at(sheet.name, line, column, f"a {what} has no name; name it")
    if any(ord(each) < 32 or 127 <= ord(each) < 160 for each in name):
        raise InputError.at(sheet.name, line, column, f"{what} {name!r} holds a control character; remove it")


def distinct_names(sheet: Sheet, cells: Iterable[tuple[int, str]], column: str | None, what: str) -> tuple[str, ...]:
    """Names of (line, cell), each once.

    Raises:
        InputError: there are none; one is empty, has control characters or comes twice.
    """
    earlier: dict[str, None] = {}
    for line, name in cells:
        check_name(sheet, line, column, what, name)
        if name in earlier:
            raise InputError.at(sheet.name, line, column, f"{what} '{name}' appears twice; keep one")
        earlier[name] = None
    if not earlier:
        raise InputError.at(sheet.name, None, None, "has a header but no tasks; add one row per task")
    return tuple(earlier)


def likeness(name: str, others: Iterable[str], otherwise: str = "") -> str:
    """The end of a message about an unknown name: "; is it 'lid'?", or `otherwise`."""
    close = difflib.get_close_matches(name, list(others), n=1, cutoff=ALIKE)
    return f"; is it '{close[0]}'?" if close else otherwise


def probabilities(
    sheet: Sheet,
    places: Iterable[tuple[int, str | None]],
    texts: Sequence[str],
    absent: Collection[str] = frozenset(),
) -> Array:
    """Many cells at once; cell by cell only where that is not enough, and to find out what is wrong.

    Args:
        sheet: a table.
        places: line and column of each cell.
        texts: the cells.
        absent: what stands, in small letters, for a probability that is not known: NaN.

    Raises:
        InputError: a cell is no probability.
    """
    if (values := _plain_probabilities(sheet, texts)) is not None:
        return values
    present = [text.casefold() not in absent for text in texts]
    if not all(present):
        values = np.full(len(texts), np.nan)
        values[present] = probabilities(sheet, compress(places, present), list(compress(texts, present)))
        return values
    return np.array([probability(sheet, *place, text) for place, text in zip(places, texts, strict=False)])


def _plain_probabilities(sheet: Sheet, texts: Sequence[str]) -> Array | None:
    joined, plain = "\n".join(texts), texts
    if sheet.decimal_comma or "%" in joined:
        joined = joined.replace(" %", "%").replace("%", "e-2")
        joined = joined.replace(".", "_").replace(",", ".") if sheet.decimal_comma else joined  # a point is refused
        plain = joined.split("\n")
    if not joined.isascii() or "_" in joined:  # Python reads more than these as numbers
        return None
    try:
        values = np.fromiter(map(float, plain), dtype=np.float64)
    except ValueError:
        return None
    is_valid = len(values) == len(texts) and bool(((values >= 0.0) & (values <= 1.0)).all())
    return values if is_valid else None

"""A table of text, and what its cells mean: costs, probabilities, counts, yes and no.

Which mark is the decimal one is a matter of the file, since "1,234" alone does not say. A number that can be read in
two ways where nothing in the file decides is refused; a guess would be wrong by a factor of a thousand.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from p2l.errors import InputError
from p2l.text import printable

LARGEST = 1e100  # of a cost; a larger one is a slip, and sums of such costs overflow
_NEVER = frozenset(("inf", "+inf", "infinity", "+infinity", "∞", "+∞", "never", "-", "–", "—"))
_NO_VALUE = frozenset(("nan", "inf", "infinity", "∞"))  # numbers to Python, but never a probability or a count
_YES = frozenset(("yes", "y", "ja", "j", "true", "t", "wahr", "1", "1.0", "1,0", "x", "on", "✓", "✔", "☑"))
_NO = frozenset(("no", "n", "nein", "false", "f", "falsch", "0", "0.0", "0,0", "off", "-", "–", "—", "✗", "☐"))
_SPACES = " \u00a0\u2009\u202f"
_NAMES = ("", "task", "name", "taught", "tested")  # columns of names, which may look like numbers: "1.10"


def _numeral(decimal: str, other: str) -> re.Pattern[str]:
    groups = f"{other}'’{_SPACES}"
    whole = rf"[1-9][0-9]{{0,2}}([{groups}])[0-9]{{3}}(?:\2[0-9]{{3}})*|[0-9]+(?=$|[{decimal}eE])|(?=[{decimal}][0-9])"
    return re.compile(rf"([+-]?(?:{whole}))(?:[{decimal}]([0-9]*))?([eE][+-]?[0-9]+)?")


_NUMERAL = {False: _numeral(".", ","), True: _numeral(",", ".")}
_MAY_TELL = {",": re.compile(r",|\.[0-9]{3}\."), ".": re.compile(r"\.|,[0-9]{3},")}  # the fast first look at a row
_NOT_DIGITS = str.maketrans("", "", f".,'’{_SPACES}")


@dataclass(frozen=True)
class Sheet:
    """A table as text: stripped cells under a header, with lines as a spreadsheet counts them.

    Attributes:
        name: of the file, for messages.
        header: names of the columns, as written; '' where a column has none.
        rows: (line, cells) of every row that is not blank, each with as many cells as the header.
        decimal_comma: whether 1,5 is a number of this file.
        header_line: line of the header.
        unclear: of "." and ",", those that may part thousands or decimals, as nothing in the file says.

    Example:
        >>> from p2l.team.cells import Sheet, number, probability
        >>> sheet = Sheet("orders.csv", ("Task", "C Rob"), ((2, ("lid", "1.234,5")),), decimal_comma=True)
        >>> place = sheet.columns(("task", "c_rob"))
        >>> place, number(sheet, 2, "C Rob", sheet.rows[0][1][place["c_rob"]])
        ({'task': 0, 'c_rob': 1}, 1234.5)
    """

    name: str
    header: tuple[str, ...]
    rows: tuple[tuple[int, tuple[str, ...]], ...]
    decimal_comma: bool
    header_line: int = 1
    unclear: str = ""

    def columns(self, known: Sequence[str]) -> dict[str, int]:
        """Place of each known column that the sheet has; capitals do not matter, spaces and hyphens are underscores.

        Raises:
            InputError: two columns are the same known one.
        """
        found: dict[str, int] = {}
        names = {normal(name): name for name in known}
        for place, written in enumerate(self.header):
            if (name := names.get(normal(written))) is None:
                continue
            if name in found:
                problem = f"means '{name}', and so does {quoted(self.header[found[name]])}; keep one"
                raise InputError.at(self.name, self.header_line, written, problem)
            found[name] = place
        return found

    def extra(self, known: Sequence[str]) -> tuple[str, ...]:
        """Names, as written, of the columns that are not known; one without a name is not among them."""
        names = {normal(name) for name in known}
        return tuple(written for written in self.header if written and normal(written) not in names)


def number(
    sheet: Sheet,
    line: int,
    column: str | None,
    text: str,
    *,
    lowest: float = 0.0,
    largest: float = LARGEST,
    empty: float | None = math.inf,
    never: bool = True,
) -> float:
    """A cost or another number: 95, 1e3, 1'234.5, or 1.234,5 where the file has decimal commas.

    Args:
        sheet: which the cell is of.
        line: of the cell.
        column: of the cell, as written in the header; None if it has no name.
        text: the cell.
        lowest: that is allowed.
        largest: that is allowed.
        empty: value of an empty cell; None refuses it.
        never: whether inf, ∞, never and - are allowed; all are infinite.

    Raises:
        InputError: the cell is no such number, or can be read as two.
    """
    if never and text.lower() in _NEVER:
        return math.inf
    if not text and empty is not None:
        return empty
    what = f"a cost of at least 0 and at most {_short(largest)}, or inf for never"
    what = what if never else f"a number from {_short(lowest)} to {_short(largest)}"
    value = _value(sheet, line, column, text, what)
    if not (lowest <= value <= largest and math.isfinite(value)):
        raise _not_allowed(sheet, line, column, text, what)
    return value + 0.0  # no -0.0


def is_number(text: str) -> bool:
    """Whether a cell is a number, of any sign, if its comma or its point is the decimal one."""
    return any(_reading(text.replace("−", "-"), comma, False) is not None for comma in (False, True))


def probability(sheet: Sheet, line: int, column: str | None, text: str, *, empty: float | None = None) -> float:
    """A probability: 0.95, 95 %, or 0,95 where the file has decimal commas.

    Args:
        sheet: which the cell is of.
        line: of the cell.
        column: of the cell, as written in the header; None if it has no name.
        text: the cell.
        empty: value of an empty cell; None refuses it.

    Raises:
        InputError: the cell is no probability; 95 without a percent sign is none.
    """
    if not text and empty is not None:
        return empty
    what = "a probability in [0, 1], such as 0.95 or 95 %"
    value = _value(sheet, line, column, text, what, percent=True, limit=1.0)
    if not 0.0 <= value <= 1.0:
        hint = f"; if {text} of a hundred is meant, write {text}%" if 1.0 < value <= 100.0 and text[-1] != "%" else ""
        raise _not_allowed(sheet, line, column, text, what + hint)
    return value + 0.0


def whole_number(
    sheet: Sheet, line: int, column: str | None, text: str, *, largest: int = 10**9, empty: int | None = None
) -> int:
    """A count: 12, 12.0 or 1'200.

    Args:
        sheet: which the cell is of.
        line: of the cell.
        column: of the cell, as written in the header; None if it has no name.
        text: the cell.
        largest: that is allowed.
        empty: value of an empty cell; None refuses it.

    Raises:
        InputError: the cell is no whole number from 0 to `largest`.
    """
    if not text and empty is not None:
        return empty
    what = f"a whole number from 0 to {largest}"
    value = _value(sheet, line, column, text, what)
    if not (0.0 <= value <= largest and value == math.floor(value)):
        raise _not_allowed(sheet, line, column, text, what)
    return int(value)


def flag(sheet: Sheet, line: int, column: str | None, text: str, *, empty: bool | None = False) -> bool:
    """Yes or no: yes, ja, true, wahr, 1, x; no, nein, false, falsch, 0, -.

    Args:
        sheet: which the cell is of.
        line: of the cell.
        column: of the cell, as written in the header; None if it has no name.
        text: the cell.
        empty: value of an empty cell; None refuses it.

    Raises:
        InputError: the cell is neither.
    """
    word = text.lower()
    if word in _YES or word in _NO:
        return word in _YES
    if text or empty is None:
        problem = f"{quoted(text)} is neither yes nor no; give yes, no, true, false, 1, 0"
        raise InputError.at(sheet.name, line, column, problem)
    return empty


def decimal_mark(header: Sequence[str], rows: Sequence[Sequence[str]], *, comma_possible: bool) -> tuple[bool, str]:
    """Whether a file has decimal commas, and which of "." and "," its other numbers leave unclear.

    Numbers that can be read in one way only decide, such as 1,5 or 1.234,5 or 0,950. A column of names decides only if
    no other does.

    Args:
        header: names of the columns.
        rows: cells, stripped.
        comma_possible: False where a comma parts the cells.
    """
    names = [place for place, name in enumerate(header) if place == 0 or normal(name) in _NAMES]
    others = [place for place in range(len(header)) if place not in names]
    lines = ["\n".join(cells) for cells in rows]
    has = {mark: any(mark in line for line in lines) for mark in ".,"}
    for mark, other in ((".", ","), (",", ".")):  # most files have one of them only
        if comma_possible and not has[other] and _tells(rows, others, mark):
            return mark == ",", ""
    comma = _tells(rows, others, ",")
    if not comma_possible:
        return False, "," if comma else ""
    point = _tells(rows, others, ".")
    comma = comma or (not point and _tells(rows, names, ","))
    return comma, ".," if comma == point else ""


def _tells(rows: Sequence[Sequence[str]], places: Sequence[int], mark: str) -> bool:
    """Whether some number makes sense only if `mark` comes before its decimals."""
    is_comma = mark == ","
    for cells in rows:
        if _MAY_TELL[mark].search("\n".join(cells)):
            for place in places:
                text = cells[place].removesuffix("%").rstrip()
                if _NUMERAL[is_comma].fullmatch(text) and not _NUMERAL[not is_comma].fullmatch(text):
                    return True
    return False


def _value(
    sheet: Sheet, line: int, column: str | None, text: str, what: str, percent: bool = False, limit: float = math.inf
) -> float:
    """The number that a cell holds, of any sign; NaN where it says so. Of two readings, one above `limit` is none."""
    plain = text.replace("−", "-")
    is_percent = percent and plain.endswith("%")
    plain = plain[:-1].rstrip() if is_percent else plain
    value = _reading(plain, sheet.decimal_comma, is_percent)
    if value is None:
        if _reading(plain, not sheet.decimal_comma, is_percent) is not None:
            marks = ("point", "comma") if sheet.decimal_comma else ("comma", "point")
            problem = f"has a decimal {marks[0]}, and numbers of this file a decimal {marks[1]}; give {what}"
            raise InputError.at(sheet.name, line, column, f"{quoted(text)} {problem}")
        if plain.lower().lstrip("+-") not in _NO_VALUE:
            raise InputError.at(sheet.name, line, column, f"{quoted(text)} is not a number; give {what}")
        return math.nan
    if any(mark in plain for mark in sheet.unclear):
        other = _reading(plain, not sheet.decimal_comma, is_percent)
        low, high = sorted((value, value if other is None else other))
        if low < high <= limit:
            problem = f"may be {_short(high)} or {_short(low)}, and no other number of the file tells"
            ways = "write it without a mark between thousands, or with another number of decimals than three"
            raise InputError.at(sheet.name, line, column, f"{quoted(text)} {problem}; {ways}; give {what}")
        return low
    return value


def _not_allowed(sheet: Sheet, line: int, column: str | None, text: str, what: str) -> InputError:
    """A number that a cell must not hold, and what it may."""
    return InputError.at(sheet.name, line, column, f"{quoted(text)} is not allowed; give {what}")


def _reading(text: str, decimal_comma: bool, percent: bool) -> float | None:
    """None where it is no number."""
    if (found := _NUMERAL[decimal_comma].fullmatch(text)) is None:
        return None
    whole, _, decimals, exponent = found.groups()
    power = int(exponent[1:]) if exponent and len(exponent) < 8 else 0
    if exponent and len(exponent) >= 8:
        return None
    return float(f"{whole.translate(_NOT_DIGITS)}.{decimals or '0'}e{power - 2 * percent}")


def quoted(text: str) -> str:
    """A cell as a message shows it: on one line, shortened, harmless to a terminal.

    Args:
        text: the cell.
    """
    return f"'{printable(text if len(text) <= 60 else text[:57] + '...', lines=False)}'"


def normal(name: str) -> str:
    """A name as it is compared: without capitals; spaces, hyphens and underscores are alike.

    Args:
        name: of a column, or of what a row is about.
    """
    return re.sub(r"[\s_\-‐-―]+", "_", name.casefold())


def _short(value: float) -> str:
    return f"{value:.12g}".replace("e+", "e")

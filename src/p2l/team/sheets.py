"""Tables as people have them: CSV from any spreadsheet, or an Excel workbook, as one `Sheet` of text.

Accepted: cells parted by commas, semicolons, tabs or "|", with quotes or without; UTF-8, UTF-16 and Windows-1252; any
line ends; decimal commas where no comma parts the cells; `sep=;` in the first line; blank lines and columns; .xlsx.
Nothing is guessed: what can be read in two ways is refused with what to do.
"""

from __future__ import annotations

import codecs
import csv
import io
import re
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

from p2l.errors import InputError
from p2l.team.cells import Sheet, decimal_mark, flag, number, probability, quoted, whole_number
from p2l.team.workbooks import Row, workbook_rows

__all__ = [
    "STANDARD_INPUT",
    "Sheet",
    "check_standard_input",
    "flag",
    "number",
    "probability",
    "read_sheet",
    "whole_number",
]

STANDARD_INPUT = "-"
_MARKS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "'|'"}
_SEPARATED = "commas, semicolons, tabs or '|'"
_CONTROL = re.compile("[\0-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]")
_BLANKS = " \t\r\n\u00a0\u1680\u2028\u2029\u202f\u205f\u3000\ufeff" + "".join(map(chr, range(0x2000, 0x200C)))
_SEP = re.compile(r'"?sep=(.)\1*"?[^\S\r\n]*(?:\r\n|\r|\n|$)', re.IGNORECASE)
_WORKBOOK = re.compile(r"(.+\.xls[xm]|-)#([^#]+)", re.IGNORECASE)
_ARCHIVE, _OLD_OFFICE = b"PK\x03\x04", b"\xd0\xcf\x11\xe0"
_HTML = re.compile(rb"(?:\xef\xbb\xbf)?\s*<(?:!doctype|html|\?xml|table|meta)", re.IGNORECASE)
_OTHERS = {
    b"%PDF": "a PDF",
    b"PAR1\x15": "a Parquet file",
    b"\x1f\x8b": "a gzip archive",
    b"PK\x05\x06": "an empty zip archive",
    b"\x89PNG": "a picture",
    b"{\\rtf": "a text document",
}


def check_standard_input(*paths: Path | str | None) -> None:
    """Refuse tables of which more than one is to come by standard input.

    Raises:
        InputError: there are such.
    """
    if sum(str(each) == STANDARD_INPUT or str(each).startswith(f"{STANDARD_INPUT}#") for each in paths) > 1:
        raise InputError.at("standard input", None, None, "can be read once; give files for the other tables")


def read_sheet(path: Path | str) -> Sheet:
    r"""Read a table: CSV of any kind, or an .xlsx workbook.

    Args:
        path: the file; `book.xlsx#Sheet` for one sheet of a workbook, or else its first; "-" for standard input.

    Raises:
        InputError: a file that is missing, empty or no table; characters that no table holds; lines of different
            lengths; a repeated column; cells that can be parted in two ways; merged cells.

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from p2l.team.sheets import read_sheet
        >>> with TemporaryDirectory() as folder:
        ...     path = Path(folder) / "orders.csv"
        ...     _ = path.write_bytes("sep=;\r\nTask;C Rob;Größe\r\nlid;1,5;\r\n".encode("cp1252"))
        ...     sheet = read_sheet(path)
        >>> sheet.header, sheet.rows, sheet.decimal_comma
        (('Task', 'C Rob', 'Größe'), ((2, ('lid', '1,5', '')),), True)
    """
    name, data, tab = _source(path)
    _refuse_what_is_no_table(name, data)
    if data.startswith(_ARCHIVE):
        name, lines = workbook_rows(name, data, tab)
        rows = [(line, _stripped(cells)) for line, cells in lines]
        return replace(
            _sheet(name, rows, suspect=True), unclear=","
        )  # its numbers have points, its texts may have anything
    if tab is not None:
        raise InputError.at(name, None, None, "is no .xlsx workbook, so it has no sheets; leave out what follows '#'")
    mark, text = _announced_mark(name, _decoded(name, data))
    marks = [mark] if mark else [each for each in _MARKS if each in text] or [","]
    mark, rows = _parted(name, text, marks)
    sheet = _sheet(name, rows, suspect=_CONTROL.search(text) is not None)
    if mark == "," and '"' not in text:  # no cell holds a comma
        return sheet
    comma, unclear = decimal_mark(sheet.header, [cells for _, cells in sheet.rows], comma_possible=mark != ",")
    return replace(sheet, decimal_comma=comma, unclear=unclear)


def _source(path: Path | str) -> tuple[str, bytes, str | None]:
    """Name for messages, content, and the sheet that is asked for."""
    name, tab = str(path), None
    if (found := _WORKBOOK.fullmatch(name)) and not Path(name).exists():
        path, tab = found.groups()
    if str(path) == STANDARD_INPUT:
        name = "standard input" if tab is None else f"standard input#{tab}"
        return name, b"" if sys.stdin is None else sys.stdin.buffer.read(), tab
    place = Path(path)
    if place.is_dir():
        raise InputError.at(name, None, None, "is a directory; give the file itself")
    if not place.exists():  # a pipe, such as the shell's <(…), will do
        raise InputError.at(name, None, None, "no such file; check the path")
    try:
        return name, place.read_bytes(), tab
    except OSError as error:
        raise InputError.at(name, None, None, f"cannot be read ({error.strerror})") from error


def _refuse_what_is_no_table(name: str, data: bytes) -> None:
    if not data.strip():
        raise InputError.at(name, None, None, "is empty; it needs a header and rows")
    if data.startswith(_OLD_OFFICE):
        if "EncryptedPackage".encode("utf-16-le") in data:
            raise InputError.at(name, None, None, "is protected by a password; save it without one, as .xlsx or CSV")
        raise InputError.at(name, None, None, "is of an old Office (.xls); save it as .xlsx or CSV")
    kinds = [kind for start, kind in _OTHERS.items() if data.startswith(start)]
    if kinds or _HTML.match(data):
        raise InputError.at(
            name, None, None, f"is {(*kinds, 'HTML or XML')[0]}; give the table itself, as .xlsx or CSV"
        )


def _decoded(name: str, data: bytes) -> str:
    """Text of what says its encoding, or is UTF-16 without doubt, or is valid UTF-8; else of Windows-1252."""
    if data.startswith(codecs.BOM_UTF8):
        encodings = ["utf-8-sig"]
    elif data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encodings = ["utf-16"]
    elif b"\0" in data:
        low, high = data[::2].count(0), data[1::2].count(0)  # of the ASCII characters of a table, one byte is 0
        most, least = max(low, high), min(low, high)
        is_wide = len(data) % 2 == 0 and 3 * most >= len(data) // 2 and 20 * least <= most
        encodings = ["utf-16-le" if high > low else "utf-16-be"] if is_wide else ["utf-8", "cp1252"]
    else:
        encodings = ["utf-8", "cp1252"]
    for encoding in encodings:
        try:
            return data.decode(encoding)
        except UnicodeDecodeError as caught:
            error = caught
    problem = f"is text of no known encoding ({error}); save it as a UTF-8 CSV file"
    raise InputError.at(name, None, None, problem) from error


def _announced_mark(name: str, text: str) -> tuple[str | None, str]:
    """What Excel's first line, `sep=;`, says, and the text without it; spreadsheets do not count that line."""
    if (found := _SEP.match(text)) is None:
        return None, text
    if found.group(1) not in _MARKS:
        problem = f"'sep={found.group(1)}' is not allowed; separate the cells by {_SEPARATED}"
        raise InputError.at(name, 1, None, problem)
    return found.group(1), text[found.end() :]


def _parted(name: str, text: str, marks: list[str]) -> tuple[str, list[Row]]:
    """The only one of `marks` that gives a header of several cells and as many in every row, and what it gives."""
    tables, problems, widths, whole = {}, {}, {}, []
    for mark in marks:
        tables[mark], problems[mark] = _rows(name, text, mark)
        widths[mark] = len(tables[mark][0][1]) if tables[mark] else 0
        is_even = all(len(cells) == widths[mark] for _, cells in tables[mark])
        if widths[mark] > 1 and is_even and problems[mark] is None:
            whole.append(mark)
    if len(whole) > 1:  # half a quoted cell is none
        whole = [
            mark for mark in whole if not any(cell.count('"') % 2 for _, cells in tables[mark] for cell in cells)
        ] or whole
    if len(whole) > 1:
        ways = " or ".join(_MARKS[mark] for mark in whole)
        problem = f"its cells can be parted at {ways}; write sep={whole[0]} as the first line, or quote such cells"
        raise InputError.at(name, None, None, problem)
    best = whole[0] if whole else max(marks, key=lambda mark: (widths[mark], problems[mark] is None))
    if (problem_of_best := problems[best]) is not None:
        raise problem_of_best
    return best, tables[best]


def _rows(name: str, text: str, mark: str) -> tuple[list[Row], InputError | None]:
    """Rows that are not blank, up to what is no CSV, and what that is; no more than the header if it has one cell."""
    rows: list[Row] = []
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=mark, strict=True, skipinitialspace=True)
    to_strip = _has_blanks(text, mark)
    line = 0
    try:
        for line, cells in enumerate(reader, 1):
            stripped = _stripped(cells) if to_strip else cells
            if any(stripped):
                rows.append((line, stripped))
                if len(rows[0][1]) == 1:
                    break
    except csv.Error as error:
        quote = "a quote is not closed, or there is text behind it; quote the whole cell, double quotes in it"
        problem = quote if "expected" in str(error) else f"is no row of a CSV file ({error})"
        return rows, InputError.at(name, line + 1, None, problem)
    return rows, None


def _has_blanks(text: str, mark: str) -> bool:
    """Whether some cell may begin or end with a blank; faster than to strip them all."""
    blanks = [blank for blank in _BLANKS if blank in text and blank not in f"\r\n{mark}"]
    beside = [pair for blank in blanks for edge in f"\r\n{mark}" for pair in (blank + edge, edge + blank)]
    return (
        '"' in text
        or text.startswith(tuple(blanks))
        or text.endswith(tuple(blanks))
        or any(map(text.__contains__, beside))
    )


def _stripped(cells: list[str]) -> list[str]:
    """Without blanks at both ends; unlike `str.strip`, it leaves control characters for others to refuse."""
    return [cell.strip(_BLANKS) for cell in cells]


def _sheet(name: str, rows: list[Row], *, suspect: bool) -> Sheet:
    """Rows that fit together, without columns that are empty all over."""
    if not rows:
        raise InputError.at(name, None, None, "is empty; it needs a header and rows")
    (first, header), *body = rows
    if suspect:
        _refuse_control_characters(name, header, rows)
    if not any(header[1:]):
        problem = f"the header has one cell only; name the columns, and separate the cells by {_SEPARATED}"
        raise InputError.at(name, first, None, problem)
    for line, cells in body:
        if len(cells) != len(header):
            raise InputError.at(name, line, None, f"has {len(cells)} cells; the header has {len(header)}")
    empty = {place for place, text in enumerate(header) if not text and not any(cells[place] for _, cells in body)}
    if empty and body:
        kept = [place for place in range(len(header)) if place not in empty]
        header, *others = ([cells[place] for place in kept] for cells in (header, *(cells for _, cells in body)))
        body = [(line, cells) for (line, _), cells in zip(body, others, strict=True)]
    if twice := [text for text, count in Counter(header).items() if text and count > 1]:
        raise InputError.at(name, first, quoted(twice[0])[1:-1], "column appears twice; keep one")
    return Sheet(name, tuple(header), tuple((line, tuple(cells)) for line, cells in body), False, first)


def _refuse_control_characters(name: str, header: list[str], rows: list[Row]) -> None:
    for line, cells in rows:
        for place, cell in enumerate(cells):
            if found := _CONTROL.search(cell):
                what = "NUL" if found.group() == "\0" else "control"
                column = quoted(header[place])[1:-1] if line > rows[0][0] and place < len(header) else ""
                raise InputError.at(name, line, column or None, f"{quoted(cell)} holds a {what} character; remove it")

"""Excel workbooks (.xlsx, .xlsm) as rows of text, by openpyxl, which is loaded when the first one is read."""

from __future__ import annotations

import datetime
import io
import re
import warnings
import zipfile
from types import ModuleType
from typing import Any

from p2l.errors import InputError

Row = tuple[int, list[str]]

_TAG = rb"(?:\w+:)?"  # some programs name the namespace of every element
_MERGED = re.compile(rb"<" + _TAG + rb"mergeCell\b[^>]*?\bref=\"([A-Z]+)(\d+):([A-Z]+)(\d+)\"")
_FORMULA = rb"<" + _TAG + rb"f\b(?:[^>]*/>|[^>]*>[^<]*</" + _TAG + rb"f>)\s*"
_NO_VALUE = rb"(?:<" + _TAG + rb"v\s*/>|<" + _TAG + rb"v>\s*</" + _TAG + rb"v>)?\s*</" + _TAG + rb"c>"
_UNKNOWN = re.compile(rb"<" + _TAG + rb"c\b([^>]*[^>/])>\s*" + _FORMULA + _NO_VALUE)
_PLACE = re.compile(rb"\br=\"([A-Z]+)(\d+)\"")


def workbook_rows(name: str, data: bytes, tab: str | None) -> tuple[str, list[Row]]:
    """What messages call a sheet, and its rows.

    The name tells which of several sheets is read if nobody has said which. Rows are those that are not blank, with
    their lines, all of the same length; numbers in full precision.

    Args:
        name: of the file, for messages.
        data: the file.
        tab: name of the sheet; the first visible one if None.

    Raises:
        InputError: no workbook, a damaged one, no such sheet, merged cells, a formula whose value is not stored.
    """
    _refuse_other_archives(name, data)
    openpyxl = _openpyxl(name)
    try:
        with warnings.catch_warnings():  # of what openpyxl leaves out: styles, validation, drawings
            warnings.simplefilter("ignore")
            book = openpyxl.load_workbook(io.BytesIO(data), read_only=True, data_only=True, keep_links=False)
            sheet = _sheet(name, book, tab)
            name = name if tab is not None else _name(name, book, sheet)
            sheet.reset_dimensions()  # some programs write wrong ones
            rows = [
                (line, [_text(value) for value in cells])
                for line, cells in enumerate(sheet.iter_rows(min_row=1, min_col=1, values_only=True), 1)
            ]
            with zipfile.ZipFile(io.BytesIO(data)) as archive:
                source = archive.read(sheet._worksheet_path)
    except InputError:
        raise
    except Exception as error:  # a damaged workbook fails anywhere in openpyxl, with any error
        problem = f"cannot be read as an Excel workbook ({type(error).__name__}: {error}); save it again, or as CSV"
        raise InputError.at(name, None, None, problem) from error
    rows = [(line, cells) for line, cells in rows if any(cell.strip() for cell in cells)]
    width = max((len(cells) for _, cells in rows), default=0)
    if rows:
        _refuse_merged_cells(name, source, rows[0][0], rows[-1][0], width)
        _refuse_unknown_values(name, source)
    return name, [(line, cells + [""] * (width - len(cells))) for line, cells in rows]


def _openpyxl(name: str) -> ModuleType:
    try:
        import openpyxl
    except ImportError as error:
        problem = "is an Excel workbook, and openpyxl, which reads them, is not installed; install it, or save as CSV"
        raise InputError.at(name, None, None, problem) from error
    return openpyxl


def _refuse_other_archives(name: str, data: bytes) -> None:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = set(archive.namelist())
    except (zipfile.BadZipFile, ValueError, NotImplementedError) as error:
        raise InputError.at(name, None, None, f"is a damaged workbook or zip archive ({error})") from error
    if any(each.lower().endswith("workbook.bin") for each in members):
        raise InputError.at(name, None, None, "is a binary workbook (.xlsb); save it as .xlsx or CSV")
    if "mimetype" in members and "content.xml" in members:
        raise InputError.at(name, None, None, "is an OpenDocument file; save it as .xlsx or CSV")
    if not any(each.lower().endswith("workbook.xml") for each in members):
        raise InputError.at(name, None, None, "is a zip archive; give the table itself, as .xlsx or CSV")


def _sheet(name: str, book: Any, tab: str | None) -> Any:
    sheets = {sheet.title: sheet for sheet in book.worksheets}
    if not sheets:
        raise InputError.at(name, None, None, "has no sheet with cells")
    if tab is None:
        return next((sheet for sheet in sheets.values() if sheet.sheet_state == "visible"), book.worksheets[0])
    for title, sheet in sheets.items():
        if title.strip().casefold() == tab.strip().casefold():
            return sheet
    raise InputError.at(name, None, None, f"has no sheet '{tab}'; it has {list(sheets)}")


def _name(name: str, book: Any, sheet: Any) -> str:
    others = [f"#{each.title}" for each in book.worksheets if each.sheet_state == "visible" and each is not sheet]
    return f"{name}#{sheet.title} (its first sheet; there {_are(len(others))} {', '.join(others)})" if others else name


def _are(many: int) -> str:
    return "is also" if many == 1 else "are also"


def _text(value: object) -> str:
    """A value as its CSV would have it, but in full precision."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).upper()
    if isinstance(value, float):
        return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)
    if isinstance(value, datetime.datetime):
        return value.isoformat(sep=" ").removesuffix(" 00:00:00")
    return str(value)


def _refuse_merged_cells(name: str, source: bytes, first: int, last: int, width: int) -> None:
    """Only the first of merged cells has a value, so all others would count as empty."""
    for left, top, right, bottom in _MERGED.findall(source):
        if int(bottom) >= first and int(top) <= last and _index(left) <= width:
            cells = f"{left.decode()}{int(top)}:{right.decode()}{int(bottom)}"
            what = "cells of the header" if int(top) <= first else "cells"
            problem = f"{what} {cells} are merged; unmerge them, so that each has a value of its own"
            raise InputError.at(name, int(top), None, problem)


def _refuse_unknown_values(name: str, source: bytes) -> None:
    """A formula that no spreadsheet has computed yet has no value, and would count as an empty cell."""
    if b"f>" not in source and b"f " not in source:
        return
    for (attributes,) in map(re.Match.groups, _UNKNOWN.finditer(source)):
        if b't="str"' not in attributes:  # that one is computed: an empty text
            place = _PLACE.search(attributes)
            cell = b"".join(place.groups()).decode() if place else "a cell"
            line = int(place.group(2)) if place else None
            problem = f"the formula in {cell} has no stored value; open the file in a spreadsheet and save it"
            raise InputError.at(name, line, None, problem)


def _index(letters: bytes) -> int:
    place = 0
    for letter in letters:
        place = 26 * place + letter - 64
    return place

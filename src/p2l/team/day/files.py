"""A day on disk: `day.csv`, a row per event, that a person may read and correct.

Every row ends with the key of the plan that it belongs to, which also says that the row is whole: a process that was
killed while it wrote leaves a row without. Rows are appended by one write and reach the disk before anything else
happens. Nothing that stands in the file is lost: rows that cannot be are set aside when the first row is written over
them.
"""

from __future__ import annotations

import csv
import io
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from p2l.artifacts import atomic, config_hash, digest_bytes
from p2l.errors import ArtifactError, InputError
from p2l.team.columns import known_columns
from p2l.team.day.entries import COLUMNS, DayEntry, cells_of
from p2l.team.day.record import Day
from p2l.team.sheets import read_sheet

DAY, REFUSED = "day.csv", "day.refused.csv"
_KEY = COLUMNS[-1]


@dataclass(frozen=True)
class DayFile:
    """What stands in `day.csv`.

    Attributes:
        entries: whole rows.
        torn: an unfinished last row, '' if there is none.
        text: all of it.
    """

    entries: tuple[DayEntry, ...]
    torn: str
    text: str


def key_of(day: Day) -> str:
    """What a day is bound to: the morning's shop and plan, and how outcomes change what is believed."""
    shop, plan = day.shop, day.plan
    assert plan is not None
    names = [shop.tasks, shop.robots, shop.lessons, shop.order, shop.max_lessons, shop.max_teaching]
    arrays = [shop.completes, shop.count, shop.choice, shop.arcs, shop.c_hum, shop.c_rob, shop.c_fail, shop.c_demo]
    arrays += [shop.pretrained, shop.transfer, day.trials, plan.taught, plan.sequence, plan.decision, plan.robot]
    numbers = [digest_bytes(np.ascontiguousarray(each).tobytes()) for each in arrays]
    return config_hash([names, numbers, day.setting.prior_n, day.setting.spread])


def read_day(path: Path, key: str) -> DayFile:
    """Rows of `day.csv`; none if it is not there.

    Raises:
        InputError: it is no day, or that of another plan.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return DayFile((), "", "")
    except OSError as error:
        raise InputError.at(path, None, None, f"cannot be read ({error.strerror})") from error
    text = data.decode("utf-8-sig", errors="replace").replace("\r\n", "\n")
    whole, end, last = text.rpartition("\n")
    mark = ";" if ";" in text.partition("\n")[0] else ","
    is_torn = bool(last) and not last.rstrip().rstrip(mark).endswith(f"{mark}{key}")
    torn, body = (last, whole + end) if is_torn else ("", text)
    entries, lines = [], csv.reader(io.StringIO(body, newline=""), delimiter=mark)
    header: list[str] | None = None
    start = 1
    try:
        for cells in lines:
            line, start = start, lines.line_num + 1
            if not any(cells):
                continue
            if header is None:
                header = _header(path, line, cells)
                continue
            entries.append(_entry(path, line, header, cells, key))
    except csv.Error as error:
        raise InputError.at(path, start, None, f"is no row of a table ({error})") from error
    return DayFile(tuple(entries), torn, text)


def read_outcomes(path: Path | str, key: str) -> list[DayEntry]:
    """Rows of a person's own table, in any form that `read_sheet` knows.

    Raises:
        InputError: no table, a misspelt column, or the day of another plan.
    """
    sheet = read_sheet(path)
    at = known_columns(sheet, COLUMNS, ("outcome",), "row")
    entries = [DayEntry(line, {name: cells[place] for name, place in at.items()}) for line, cells in sheet.rows]
    for entry in entries:
        _check_key(Path(sheet.name), entry, key)
    return entries


def append_event(path: Path, day: Day, key: str, size: int) -> int:
    """Append the row of a day's last event; returns the size of the file then.

    Args:
        path: of `day.csv`.
        day: with the event.
        key: of the plan.
        size: bytes that the file has, as far as the caller knows.

    Raises:
        InputError: it has grown since, or cannot be written.
    """
    row = _text([cells_of(day.shop, day.events[-1], len(day.events), key)], header=size == 0)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
        try:
            if os.fstat(handle).st_size != size:
                problem = "has changed since it was read; somebody else enters outcomes. Start again"
                raise InputError.at(path, None, None, problem)
            data = row.encode()
            if os.write(handle, data) != len(data):
                raise InputError.at(path, None, None, "cannot be written to its end (the disk is full)")
            os.fsync(handle)
        finally:
            os.close(handle)
        if size == 0:
            _sync(path.parent)
    except OSError as error:
        raise InputError.at(path, None, None, f"cannot be written ({error.strerror})") from error
    return size + len(data)


def restore(path: Path, day: Day, key: str, file: DayFile, wrong: DayEntry | None) -> int:
    """Leave the good rows in `day.csv`, and what followed them in `day.refused.csv`; returns the size of the first.

    Args:
        path: of `day.csv`.
        day: after the good rows.
        key: of the plan.
        file: what stands there.
        wrong: the first row that cannot be, None if only the last is torn or none is.

    Raises:
        ArtifactError: it cannot be written.
    """
    good = _text([cells_of(day.shop, event, step, key) for step, event in enumerate(day.events, start=1)], header=True)
    good = good if day.events else ""
    if file.text == good:
        return len(good.encode())
    lines = file.text.splitlines(keepends=True)
    rest = file.torn if wrong is None else "".join(lines[wrong.line - 1 :])
    if rest:
        aside = path.with_name(REFUSED)
        before = aside.read_text(encoding="utf-8") if aside.is_file() else ""
        _write(aside, before + rest + ("" if rest.endswith("\n") else "\n"))
    _write(path, good)
    return len(good.encode())


def _header(path: Path, line: int, cells: list[str]) -> list[str]:
    header = [cell.strip().casefold() for cell in cells]
    if missing := [name for name in COLUMNS if name not in header and name != "note"]:
        raise InputError.at(path, line, missing[0], "column is missing; this is no day of ours")
    return header


def _entry(path: Path, line: int, header: list[str], cells: list[str], key: str) -> DayEntry:
    entry = DayEntry(line, dict(zip(header, cells, strict=False)))
    _check_key(path, entry, key)
    return entry


def _check_key(path: Path, entry: DayEntry, key: str) -> None:
    if entry[_KEY] and entry[_KEY] != key:
        problem = f"'{entry[_KEY]}' is another plan, or one with other settings (prior_n, spread); this one is {key}"
        raise InputError.at(path, entry.line, _KEY, problem)


def _text(rows: list[dict[str, str]], *, header: bool) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    if header:
        writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _write(path: Path, text: str) -> None:
    """Atomically, and on the disk when it returns."""
    try:
        with atomic(path) as temporary, temporary.open("wb") as stream:
            stream.write(text.encode())
            stream.flush()
            os.fsync(stream.fileno())
        _sync(path.parent)
    except OSError as error:
        raise ArtifactError(f"{path}: cannot be written ({error.strerror})") from error


def _sync(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)

"""Are a plan's reasons what solving again gives? Unlike the check of the plan itself, this asks the planner."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

from p2l.errors import ArtifactError, InputError
from p2l.team.shop.files import REASONS, SUMMARY, UNKNOWN, WITHOUT, read_summary, reasons_text
from p2l.team.shop.reasons import reasons_of, tells_costs
from p2l.team.shop.record import Shop, ShopPlan

_KEY = ("lesson", "robot", "given")
_NUMBERS = ("c_demo", "saving", "saving_others_fixed", "given_below")
_AGREES = 1e-8  # relative to the plan's cost: both optima are proven to a tenth of it
_Rows = Mapping[tuple[str, ...], tuple[int, Mapping[str, str]]]  # line and cells


class CheckedReasons(NamedTuple):
    """How many numbers were compared, and how many could not be for want of time, now or when they were written."""

    compared: int
    unknown: int


def check_reasons(folder: Path | str, shop: Shop, plan: ShopPlan, *, time_limit_s: float) -> CheckedReasons | None:
    """Solve again for `reasons.csv` and for the cost without lessons in `plan.json`; None without a `reasons.csv`.

    Args:
        folder: what `files.write_shop_plan` has written.
        shop: the day.
        plan: the plan in the folder.
        time_limit_s: wall seconds for all of it.

    Raises:
        ArtifactError: a file cannot be read.
        InputError: a number or a row is not what these tasks give.
    """
    path, summary = Path(folder) / REASONS, read_summary(Path(folder))
    if not path.exists():
        return None
    try:
        written = _rows(path.read_bytes().decode().splitlines(keepends=True))
    except (OSError, csv.Error, KeyError, ValueError) as error:
        raise ArtifactError(f"{path}: cannot be read as the reasons of a plan ({error}); plan again") from error
    fresh = reasons_of(shop, plan, time_limit_s=time_limit_s)
    slack = _AGREES * max(1.0, abs(plan.objective))
    truth = _rows(reasons_text(shop, fresh).splitlines(keepends=True))
    was_whole, is_whole = not summary.get(UNKNOWN), not fresh.unknown
    counts = [_without_lessons(path.with_name(SUMMARY), summary, fresh.alone, was_whole, slack)]
    for key, (line, row) in written.items():
        if key in truth:
            if row["given_below"] and not tells_costs(shop):
                problem = f"'{row['given_below']}' is there, and with max_teaching that is not told; plan again"
                raise InputError.at(path, line, "given_below", problem)
            counts.append(_compared(path, line, row, truth[key][1], slack))
        elif key[2] == "yes" or not tells_costs(shop) or (is_whole and not _is_nothing(row, slack)):
            raise InputError.at(path, line, "lesson", f"'{key[0]}' is no such lesson of this plan; plan again")
    for key, (_, row) in truth.items():
        if key not in written and (key[2] == "yes" or (was_whole and not _is_nothing(row, slack))):
            raise InputError.at(path, None, "lesson", f"a row for '{key[0]}' is missing; plan again")
    return CheckedReasons(sum(each.compared for each in counts), sum(each.unknown for each in counts))


def _rows(lines: Iterable[str]) -> _Rows:
    header, *body = csv.reader(lines, strict=True)
    rows: dict[tuple[str, ...], tuple[int, Mapping[str, str]]] = {}
    for line, cells in enumerate(body, start=2):
        row = dict(zip(header, cells, strict=True))
        key = tuple(row.pop(name) for name in _KEY)
        if key in rows or set(row) != {*_NUMBERS, "serves"} or key[2] not in ("yes", "no"):
            raise ValueError(f"row {line} is there twice, or none of ours")
        rows[key] = line, row
    return rows


def _is_nothing(row: Mapping[str, str], slack: float) -> bool:
    """Whether a lesson that is not given pays only if it costs nothing, which rounding may bring in or leave out."""
    below = _value(row["given_below"])
    return below is not None and below <= slack


def _without_lessons(
    path: Path, summary: Mapping[str, object], alone: float, was_whole: bool, slack: float
) -> CheckedReasons:
    told = summary.get(WITHOUT)
    if math.isnan(alone) or (told is None and not was_whole):
        return CheckedReasons(0, 1)
    value = math.inf if told is None else float(told) if isinstance(told, (int, float)) else math.nan
    if not _agree(value, alone, slack):
        raise InputError.at(path, None, None, f"its '{WITHOUT}' is {told}, but solving again gives {alone:.12g}")
    return CheckedReasons(1, 0)


def _compared(path: Path, line: int, row: Mapping[str, str], truth: Mapping[str, str], slack: float) -> CheckedReasons:
    compared = unknown = 0
    if row["serves"] != truth["serves"]:
        raise InputError.at(path, line, "serves", f"is not what the plan says ('{truth['serves']}'); plan again")
    for name in _NUMBERS:
        told, found = _value(row[name]), _value(truth[name])
        if told is None or found is None:
            unknown += told is not found
            continue
        if not _agree(told, found, slack):
            problem = f"'{row[name]}' is not what solving again gives ({truth[name]}); plan again"
            raise InputError.at(path, line, name, problem)
        compared += 1
    return CheckedReasons(compared, unknown)


def _value(cell: str) -> float | None:
    """None for an empty cell; NaN, which agrees with nothing, for what is no number."""
    if not cell:
        return None
    try:
        return float(cell)
    except ValueError:
        return math.nan


def _agree(told: float, found: float, slack: float) -> bool:
    return told == found or abs(told - found) <= slack + _AGREES * abs(found)

"""Prose whose every number comes from a committed table, so that none goes stale.

A page is a Jinja2 template, such as `docs/results.md.j2`. In it `cell(table, method, setting, metric)` is one row of a
table of `evaluation.rows`, `look(table, column, **where)` one value of any other table, and filters write them:

- `ci`: the mean with its 95 % interval, `861 (835 to 898)`; `mean`: without it; `thesis`: the thesis's number.
- `pct`, `pct_mean`, `pct_thesis`: the same in percent; `points`: a difference in percentage points, with its sign.

What the tables do not hold raises an error that names it, so that a page is never written with a hole.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd

from p2l.errors import ArtifactError


@dataclass(frozen=True)
class Cell:
    """A row of a table: mean with its 95 % interval, the number of samples, and the thesis's number; NaN: none."""

    mean: float
    low: float
    high: float
    n: int
    thesis: float


def render_page(template: str, tables: Path) -> str:
    """The page of a template.

    Args:
        template: Jinja2, see the module.
        tables: folder of the CSV files.

    Raises:
        ArtifactError: the template is wrong, or asks for what no table holds, or for a number that is not there.
    """

    @cache
    def table(name: str) -> pd.DataFrame:
        path = tables / f"{name}.csv"
        try:
            return pd.read_csv(path, keep_default_na=True).fillna({"setting": ""})
        except (OSError, ValueError) as error:
            raise ArtifactError(f"{path}: cannot be read ({error})") from error

    def rows_of(name: str, where: Mapping[str, Any]) -> pd.DataFrame:
        found = table(name)
        for column, value in where.items():
            if column not in found:
                raise ArtifactError(f"{tables / name}.csv: has no column {column}; it has {', '.join(map(str, found))}")
            found = found[found[column].astype(str) == str(value)]
        if len(found) != 1:
            asked = ", ".join(f"{column}={value}" for column, value in where.items())
            raise ArtifactError(f"{tables / name}.csv: {len(found)} rows with {asked}; a page wants one")
        return found

    def cell(name: str, method: str, setting: str, metric: str) -> Cell:
        row = rows_of(name, {"method": method, "setting": setting, "metric": metric}).iloc[0]
        numbers = {each: float(row[each]) for each in ("mean", "low", "high", "thesis")}
        return Cell(n=int(row["n"]), **numbers)

    def look(name: str, column: str, **where: Any) -> Any:
        found = rows_of(name, where)
        if column not in found:
            raise ArtifactError(f"{tables / name}.csv: has no column {column}; it has {', '.join(map(str, found))}")
        return found[column].iloc[0]

    environment = jinja2.Environment(
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        autoescape=False,
    )
    environment.globals.update({"cell": cell, "look": look, "table": table})
    environment.filters.update(FILTERS)
    try:
        page = environment.from_string(template).render()
    except (jinja2.TemplateError, TypeError, AttributeError) as error:  # the latter two: a filter given something else
        raise ArtifactError(f"the page's template: {error}") from error
    return "".join(f"{line.rstrip()}\n" for line in page.splitlines())


def number(value: float, digits: int = 0) -> str:
    """With so many digits after the point, and commas between thousands; −0 is 0.

    Raises:
        ArtifactError: there is none.
    """
    if not math.isfinite(value):
        raise ArtifactError("a page asks for a number that its table leaves empty")
    text = f"{value:,.{digits}f}"
    return text.lstrip("-") if round(value, digits) == 0.0 else text


def interval(cell: Cell, digits: int = 0, scale: float = 1.0, unit: str = "") -> str:
    """`mean unit (low to high)`; the mean alone where it has no interval, or one of no width."""
    mean, low, high = (scale * each for each in (cell.mean, cell.low, cell.high))
    text = f"{number(mean, digits)}{unit}"
    if math.isnan(low) or number(low, digits) == number(high, digits):
        return text
    return f"{text} ({number(low, digits)} to {number(high, digits)})"


def points(cell: Cell, digits: int = 1) -> str:
    """A difference of two rates in percentage points, with its sign."""
    text = interval(cell, digits, 100.0)
    return f"+{text}" if round(100.0 * cell.mean, digits) > 0.0 else text


FILTERS: Mapping[str, Callable[..., str]] = {
    "ci": interval,
    "mean": lambda cell, digits=0: number(cell.mean, digits),
    "thesis": lambda cell, digits=0: number(cell.thesis, digits),
    "pct": lambda cell, digits=1: interval(cell, digits, 100.0, " %"),
    "pct_mean": lambda cell, digits=1: f"{number(100.0 * cell.mean, digits)} %",
    "pct_thesis": lambda cell, digits=1: f"{number(100.0 * cell.thesis, digits).removesuffix('.0')} %",
    "points": points,
    "num": number,
}

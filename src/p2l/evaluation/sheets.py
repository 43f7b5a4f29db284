"""Tables as CSV and figures as PNG: what stages write for readers and for later tables."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from p2l.artifacts import atomic
from p2l.errors import ArtifactError
from p2l.manifest import read_checked

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class StageReport:
    """Headline numbers, files and notes of a stage, besides its outputs."""

    metrics: Mapping[str, float]
    files: Sequence[Path]
    notes: Sequence[str] = ()


def save_sheets(out: Path, tables: Mapping[str, pd.DataFrame], figures: Mapping[str, Figure]) -> None:
    """Write `<name>.csv` of every table, to six digits, and `<name>.png` of every figure."""
    for name, table in tables.items():
        with atomic(out / f"{name}.csv") as temporary:
            table.to_csv(temporary, index=False, float_format="%.6g")
    if figures:
        from p2l.evaluation.style import png  # matplotlib, which tables alone do without
    for name, figure in figures.items():
        with atomic(out / f"{name}.png") as temporary:
            temporary.write_bytes(png(figure))


def load_sheet(path: Path, columns: Sequence[str], advice: str) -> pd.DataFrame:
    """Read a CSV of a stage that has at least `columns`; `advice` is the remedy in an error's message.

    Raises:
        ArtifactError: missing, unreadable, not as it was written, or without one of the columns.
    """
    try:
        table = pd.read_csv(io.BytesIO(read_checked(path, advice)))
    except ValueError as error:
        raise ArtifactError(f"{path}: cannot be read ({error}); {advice}") from error
    if missing := [name for name in columns if name not in table]:
        raise ArtifactError(f"{path}: lacks columns {', '.join(missing)}; {advice}")
    return table


def aggregates(table: pd.DataFrame) -> pd.DataFrame:
    """The rows over all seeds; the settings of single seeds hold `;seed=…`."""
    return table[~table["setting"].str.contains(";seed=", regex=False)]

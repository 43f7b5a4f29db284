"""The thesis's own numbers and claims (`data/thesis/`), to stand beside ours."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from p2l.errors import InputError

NUMBER_COLUMNS = ("item", "method", "setting", "metric", "value")
CLAIM_COLUMNS = ("item", "claim", "text")
KEYS = ["method", "setting", "metric"]


@dataclass(frozen=True)
class Thesis:
    """A chapter's numbers and claims.

    Attributes:
        numbers: columns `NUMBER_COLUMNS`; a table or figure is an `item`.
        claims: (item, claim) → what the text says.
    """

    numbers: pd.DataFrame
    claims: dict[tuple[str, str], str]

    def beside(self, table: pd.DataFrame, item: str) -> pd.DataFrame:
        """`table` with a column `thesis`: the number of `item` for the same method, setting and metric, else NaN."""
        mine = self.numbers[self.numbers["item"] == item].set_index(KEYS)["value"]
        index = pd.MultiIndex.from_frame(table[KEYS])
        return table.assign(thesis=mine.reindex(index).to_numpy(dtype=float))

    def value(self, item: str, method: str, setting: str, metric: str) -> float | None:
        """One number, or None where the thesis gives none."""
        rows = self.numbers[(self.numbers[["item", *KEYS]] == [item, method, setting, metric]).all(axis=1)]
        return float(rows["value"].iloc[0]) if len(rows) else None


def load_thesis(folder: Path | str, chapter: int) -> Thesis:
    """Read `chapter<k>.csv` and `chapter<k>_claims.csv`.

    Raises:
        InputError: a file is missing, unreadable, or has other columns, or a number that is none.
    """
    numbers = _read(Path(folder) / f"chapter{chapter}.csv", NUMBER_COLUMNS)
    claims = _read(Path(folder) / f"chapter{chapter}_claims.csv", CLAIM_COLUMNS)
    value = pd.to_numeric(numbers["value"], errors="coerce")
    if value.isna().any():
        row = int(value.isna().to_numpy().argmax())
        path = Path(folder) / f"chapter{chapter}.csv"
        raise InputError.at(path, row + 2, "value", f"given '{numbers['value'].iloc[row]}'; expected a number")
    keys = zip(claims["item"], claims["claim"], strict=True)
    return Thesis(numbers.assign(value=value), dict(zip(keys, claims["text"], strict=True)))


def _read(path: Path, columns: tuple[str, ...]) -> pd.DataFrame:
    try:
        table = pd.read_csv(path, dtype=str, keep_default_na=False)
    except (OSError, ValueError) as error:
        raise InputError.at(path, None, None, f"cannot be read ({error})") from error
    if tuple(table.columns) != columns:
        raise InputError.at(path, 1, None, f"columns are {', '.join(table.columns)}; expected {', '.join(columns)}")
    return table

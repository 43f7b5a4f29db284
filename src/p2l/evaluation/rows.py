"""Rows of the long tables that hold every chapter's results.

`mean` with `low` and `high` is an estimate and its 95 % interval, empty where there is none; `n` is the number of its
samples; `thesis` is the thesis's number, empty where it gives none. A `setting` is `name=value` pairs joined by `;`; a
row with a `seed` is that of a single training.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pandas as pd

from p2l.evaluation.statistics import Interval, rate_interval, wilson_interval

COLUMNS = ("method", "setting", "metric", "mean", "low", "high", "n", "thesis")
Row = tuple[str, str, str, float, float, float, int]


def single_row(method: str, setting: str, metric: str, value: float, n: int = 1) -> Row:
    """A number without an interval."""
    return method, setting, metric, float(value), np.nan, np.nan, n


def interval_row(method: str, setting: str, metric: str, interval: Interval) -> Row:
    """A mean with its limits."""
    return method, setting, metric, float(interval.mean), float(interval.low), float(interval.high), interval.n


def rate_row(method: str, setting: str, metric: str, successes: int, trials: int) -> Row:
    """A rate with Wilson limits; all three are empty where nothing was tried."""
    if not trials:
        return method, setting, metric, np.nan, np.nan, np.nan, 0
    low, high = wilson_interval(successes, trials)
    return method, setting, metric, successes / trials, float(low), float(high), trials


def trained_row(method: str, setting: str, metric: str, hits: npt.ArrayLike, seeds: npt.ArrayLike) -> Row:
    """A rate of something learnt, from outcomes [N] with the seed [N] of the training behind each (`rate_interval`)."""
    outcomes = pd.DataFrame({"hit": np.asarray(hits, dtype=float), "seed": np.asarray(seeds)})
    counts = outcomes.groupby("seed")["hit"].agg(["sum", "count"])
    return interval_row(method, setting, metric, rate_interval(counts["sum"], counts["count"]))


def table_of(rows: Sequence[Row] | pd.DataFrame) -> pd.DataFrame:
    """A table of all `COLUMNS` but the thesis's number (see `evaluation.thesis.Thesis.beside`), each of its type."""
    table = pd.DataFrame(rows, columns=list(COLUMNS[:-1]))
    return table.astype({"mean": float, "low": float, "high": float, "n": int})


def setting_of(*parts: str) -> str:
    """The setting of those parts that are not empty."""
    return ";".join(part for part in parts if part)

"""Scores and calibration of predicted probabilities of success, with intervals that resample tasks.

Pairs of a training and a test task form groups: `new_test`, where only the test task is held out from fitting,
`both_new`, where both are, and `planned`, those that plans rely on. Intervals resample test tasks, not pairs, since
pairs of a task are alike.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from p2l.artifacts import finite
from p2l.evaluation.statistics import resample_weights, wilson_interval
from p2l.records import Array, IntArray
from p2l.transfer import calibration

SCORES: dict[str, Callable[..., Array]] = {
    "auc": calibration.auc,
    "brier": calibration.brier,
    "log_loss": calibration.log_loss,
    "ece": calibration.ece,
}
RESAMPLES = 1000


@dataclass(frozen=True)
class Predictions:
    """A method's predictions for one group of pairs; every array is [N].

    Attributes:
        method: which predictor.
        pairs: `new_test`, `both_new` or `planned`.
        p: predicted probability.
        successes: of `draws` executions.
        train_task: number of the task that the skill was trained on.
        test_task: number of the task that it is tried on.
    """

    method: str
    pairs: str
    p: Array
    successes: IntArray
    draws: int
    train_task: IntArray
    test_task: IntArray


def score_table(predictions: list[Predictions], rng: np.random.Generator, level: float = 0.95) -> pd.DataFrame:
    """One row per method, group of pairs and score: `method, pairs, metric, mean, low, high, n` (n pairs).

    A score that the data do not define (AUC with successes only) is NaN.
    """
    rows = []
    for one in predictions:
        weights = task_weights(one, RESAMPLES, rng)
        for name, score in SCORES.items():
            value = float(score(one.p, one.successes, one.draws))
            with np.errstate(invalid="ignore", divide="ignore"):
                replicates = score(one.p, one.successes, one.draws, weights)
            replicates = replicates[np.isfinite(replicates)]
            limits = [0.5 - level / 2, 0.5 + level / 2]
            low, high = np.quantile(replicates, limits) if replicates.size else (np.nan, np.nan)
            rows.append((one.method, one.pairs, name, value, float(low), float(high), len(one.p)))
    return pd.DataFrame(rows, columns=["method", "pairs", "metric", "mean", "low", "high", "n"])


def records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """The rows as plain data for JSON; what is not finite becomes None."""
    columns = [table[name].tolist() for name in table.columns]
    plain = [[finite(x) if isinstance(x, float) else x for x in column] for column in columns]
    return [dict(zip(table.columns, row, strict=True)) for row in zip(*plain, strict=True)]


def task_weights(predictions: Predictions, resamples: int, rng: np.random.Generator) -> Array:
    """[resamples, N] how often each pair is drawn when its held-out tasks are drawn with replacement."""
    tasks = np.unique(predictions.test_task)
    counts = resample_weights(len(tasks), resamples, rng)
    weights = counts[:, np.searchsorted(tasks, predictions.test_task)]
    if predictions.pairs == "both_new":  # training tasks are held out as well, and drawn with the same counts
        weights = weights * counts[:, np.searchsorted(tasks, predictions.train_task)]
    return weights


def calibration_table(predictions: list[Predictions], bins: int = 10) -> pd.DataFrame:
    """Reliability of each method over both groups of pairs, with Wilson intervals of the success rate.

    Columns `method, low_p, high_p, mean_p, rate, low, high, successes, executions, pairs`. The intervals take
    executions as independent, which those of one task are not quite.
    """
    tables = []
    for method in dict.fromkeys(one.method for one in predictions):
        mine = [one for one in predictions if one.method == method]
        p, successes = np.concatenate([one.p for one in mine]), np.concatenate([one.successes for one in mine])
        curve = calibration.reliability(p, successes, mine[0].draws, bins)
        low, high = wilson_interval(curve.successes, curve.executions)
        columns = {
            "method": method,
            "low_p": curve.low,
            "high_p": curve.high,
            "mean_p": curve.mean_p,
            "rate": curve.rate,
            "low": low,
            "high": high,
            "successes": curve.successes,
            "executions": curve.executions,
            "pairs": curve.pairs,
        }
        tables.append(pd.DataFrame(columns))
    return pd.concat(tables, ignore_index=True)

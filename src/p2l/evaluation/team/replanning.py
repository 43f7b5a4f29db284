"""Planning anew against planning once: executed cost, what is saved, and what price of imperfect prediction is left.

Rows are of one set, regime, level and way (`p2l.team.day.simulation.WAYS`, and `adl_true`, the plan from the true
transfer, planned once). All is paired by set.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from p2l.evaluation.rows import Row, interval_row, table_of
from p2l.evaluation.statistics import Interval, paired_difference, t_interval
from p2l.records import Array
from p2l.team.day.simulation import WAYS

TRUTH = "adl_true"
_RESAMPLES = 2000
_POOLED = "regime=all;pretrained=all"


@dataclass(frozen=True)
class ReplanningVariant:
    """Results with one predictor.

    Attributes:
        domain: its name.
        encoding: of pairs of tasks.
        skills: `predicted` or `measured`, what is known of pre-trained skills in the morning.
        rows: columns set, regime, level, way, cost, demos, delegated, failures; means over the set's walks.
    """

    domain: str
    encoding: str
    skills: str
    rows: pd.DataFrame

    @property
    def setting(self) -> str:
        """What it is, as part of a setting."""
        return f"domain={self.domain};predictor={self.encoding};skills={self.skills}"


def replanning_table(variants: Sequence[ReplanningVariant], rng: np.random.Generator) -> pd.DataFrame:
    """Every way in every case, then over all cases of a variant (a set's mean over them is one sample).

    `executed_saving` is the cost of `once` minus a way's, `executed_price` a way's minus that of `adl_true`, and
    `price_regained` the mean saving as a share of the mean price of `once`, with an interval over resampled sets; it is
    left out where `once` pays no price.

    Args:
        variants: what is told of.
        rng: draws the resampled sets.
    """
    rows: list[Row] = []
    for variant in variants:
        frame = variant.rows
        for regime, level in sorted({(row[0], row[1]) for row in frame[["regime", "level"]].to_numpy().tolist()}):
            case = frame[(frame["regime"] == regime) & (frame["level"] == level)]
            rows += _case(case, f"{variant.setting};regime={regime};pretrained={level}", rng)
        if frame.groupby(["regime", "level"]).ngroups > 1:
            rows += _case(frame, f"{variant.setting};{_POOLED}", rng)
    return table_of(rows).assign(thesis=np.nan)


def _case(rows: pd.DataFrame, setting: str, rng: np.random.Generator) -> list[Row]:
    told: list[Row] = []
    cost = {way: _by_set(rows, way, "cost") for way in (*WAYS, TRUTH)}
    for way in (*WAYS, TRUTH):
        told.append(interval_row(way, setting, "executed_cost", t_interval(cost[way])))
        for metric in ("demos", "delegated", "failures"):
            told.append(interval_row(way, setting, metric, t_interval(_by_set(rows, way, metric))))
        if way != TRUTH:
            told.append(interval_row(way, setting, "executed_price", paired_difference(cost[way], cost[TRUTH])))
        if way not in ("once", TRUTH):
            told.append(interval_row(way, setting, "executed_saving", paired_difference(cost["once"], cost[way])))
            share = _share(cost["once"] - cost[way], cost["once"] - cost[TRUTH], rng)
            if share is not None:
                told.append(interval_row(way, setting, "price_regained", share))
    return told


def _by_set(rows: pd.DataFrame, way: str, column: str) -> Array:
    """[S] means over the cases of each set."""
    mine = rows[rows["way"] == way].groupby("set", sort=True)[column].mean()
    return np.asarray(mine.to_numpy(dtype=float))


def _share(saving: Array, price: Array, rng: np.random.Generator) -> Interval | None:
    """Ratio of means; limits are quantiles over resampled sets in which there is a price."""
    if price.mean() <= 0.0:
        return None
    sets = rng.integers(len(saving), size=(_RESAMPLES, len(saving)))
    savings, prices = saving[sets].mean(axis=1), price[sets].mean(axis=1)
    shares = savings[prices > 0.0] / prices[prices > 0.0]
    low, high = np.quantile(shares, (0.025, 0.975))
    return Interval(np.asarray(saving.mean() / price.mean()), np.asarray(low), np.asarray(high), len(saving))

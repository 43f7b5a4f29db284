"""The tables and the figures' data of chapter 3, as long tables beside the thesis's numbers.

Columns are those of `evaluation.rows`; limits are 95 % t intervals of a mean over `n` task sets.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from p2l.evaluation.rows import COLUMNS, Row, interval_row, single_row, table_of
from p2l.evaluation.statistics import Interval, paired_difference, t_interval
from p2l.evaluation.thesis import Thesis
from p2l.records import Array

HIGH, LOW = "high_teaching", "low_teaching"
COUNTS = ("demos", "delegated", "failures")
BOARD_METRICS = ("demos", "delegated", "attempts", "failures", "predicted_cost", "executed_cost")


def table_3_1(results: pd.DataFrame, thesis: Thesis) -> pd.DataFrame:
    """Each order of the board: what ADL decides and what it costs, and the same with the true transfer matrix."""
    mine = results[results["method"].isin(["adl", "adl_true"])].sort_values(["method", "set"])
    rows = [
        single_row(case["method"], f"order={case['set'] + 1}", metric, case[metric])
        for case in mine.to_dict("records")
        for metric in BOARD_METRICS
    ]
    return thesis.beside(table_of(rows), "table_3_1")


def table_3_2(results: pd.DataFrame, thesis: Thesis) -> pd.DataFrame:
    """No pre-training and costly teaching: cost and counts with standard deviations, and percent more than ADL."""
    cases = results[(results["regime"] == HIGH) & (results["level"] == 0)]
    values = {str(name): group.sort_values("set") for name, group in cases.groupby("method", sort=True)}
    rows: list[Row] = []
    for method, group in values.items():
        for metric in ("executed_cost", "predicted_cost", *COUNTS):
            sample = group[metric].to_numpy(dtype=float)
            rows.append(interval_row(method, "pretrained=0", metric, t_interval(sample)))
            spread = float(np.std(sample, ddof=1)) if len(sample) > 1 else np.nan
            rows.append(single_row(method, "pretrained=0", f"{metric}_sd", spread, len(sample)))
        if method != "adl" and "adl" in values:
            percent = percent_over(group["executed_cost"].to_numpy(), values["adl"]["executed_cost"].to_numpy())
            rows.append(interval_row(method, "pretrained=0", "percent_over_adl", percent))
    return thesis.beside(table_of(rows), "table_3_2")


def percent_over(cost: Array, base: Array) -> Interval:
    """How many percent the mean cost lies above the base's, paired by set; limits by the delta method."""
    ratio = float(np.mean(cost) / np.mean(base))
    around = t_interval((cost - ratio * base) / np.mean(base))
    low, high = (100.0 * (ratio - 1.0 + limit) for limit in (around.low, around.high))
    return Interval(np.asarray(100.0 * (ratio - 1.0)), np.asarray(low), np.asarray(high), around.n)


def figure_3_7(summary: pd.DataFrame, thetas: Mapping[str, float], thesis: Thesis) -> pd.DataFrame:
    """Costs and counts against the number of pre-trained skills where teaching is costly; setting `pretrained=l`."""
    mine = summary[summary["regime"] == HIGH]
    table = _of_summary(mine, [f"pretrained={level}" for level in mine["level"]])
    threshold = table_of([single_row("cba_best", "", "theta", thetas[HIGH])] if HIGH in thetas else [])
    return thesis.beside(_stack([table, threshold]), "figure_3_7")


def figure_3_10(summary: pd.DataFrame, thesis: Thesis) -> pd.DataFrame:
    """Both cost regimes; setting `regime=…;pretrained=l`."""
    return thesis.beside(_of_summary(summary, _cases(summary)), "figure_3_10")


def order_any(results: pd.DataFrame, domain: str, thesis: Thesis) -> pd.DataFrame:
    """The saving of any order of work (section 6.2.1): ADL minus ADL with any order, on the same sets."""
    kinds = ("executed", "predicted")
    return thesis.beside(_differences(results, domain, "adl_any", "saving", kinds), "order_any")


def prediction_price(results: pd.DataFrame, domain: str, thesis: Thesis) -> pd.DataFrame:
    """The price of prediction: ADL minus the same planner with the true transfer matrix, on the same sets."""
    return thesis.beside(_differences(results, domain, "adl_true", "price", ("executed",)), "prediction_price")


def transfer_scores(scores: Iterable[Mapping[str, Any]], domain: str, thesis: Thesis) -> pd.DataFrame:
    """Scores on held-out tasks, from `fit_transfer`'s metrics; limits resample held-out tasks, n counts pairs."""
    rows: list[Row] = []
    for score in scores:
        mean, low, high = (np.nan if score[name] is None else float(score[name]) for name in ("mean", "low", "high"))
        setting = f"domain={domain};pairs={score['pairs']}"
        rows.append((str(score["method"]), setting, str(score["metric"]), mean, low, high, int(score["n"])))
    return thesis.beside(table_of(rows), "transfer_model")


def walls(collection: Mapping[str, Any], domain: str, thesis: Thesis) -> pd.DataFrame:
    """Success of skills on their own task with and without walls (Wilson limits, n executions), from `collect`."""
    names = {"walls=kept": "own_task_success", "walls=removed": "own_task_success_without_walls"}
    rows = [
        ("skill", f"domain={domain};{setting}", "success", rate["mean"], rate["low"], rate["high"], rate["trials"])
        for setting, key in names.items()
        if (rate := collection.get(key)) is not None
    ]
    return thesis.beside(table_of(rows), "walls")


def _differences(results: pd.DataFrame, domain: str, method: str, name: str, kinds: tuple[str, ...]) -> pd.DataFrame:
    """ADL's costs minus those of `method`, paired by set."""
    rows = []
    for (regime, level), group in results.groupby(["regime", "level"], sort=True):
        ours, other = (group[group["method"] == one].sort_values("set") for one in ("adl", method))
        for kind in kinds:
            difference = paired_difference(ours[f"{kind}_cost"].to_numpy(), other[f"{kind}_cost"].to_numpy())
            setting = f"domain={domain};regime={regime};pretrained={level}"
            rows.append(interval_row(method, setting, f"{kind}_{name}", difference))
    return table_of(rows)


def _of_summary(summary: pd.DataFrame, settings: list[str]) -> pd.DataFrame:
    return summary.assign(setting=settings)[list(COLUMNS[:-1])].reset_index(drop=True)


def _cases(summary: pd.DataFrame) -> list[str]:
    pairs = zip(summary["regime"], summary["level"], strict=True)
    return [f"regime={regime};pretrained={level}" for regime, level in pairs]


def _stack(tables: list[pd.DataFrame]) -> pd.DataFrame:
    return pd.concat([table for table in tables if len(table)], ignore_index=True)

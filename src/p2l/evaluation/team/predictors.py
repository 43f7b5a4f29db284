"""Predictors of transfer side by side: ADL's plans made with each, executed on the same sets.

A variant is a way to know what a skill is worth before it is used: how pairs of tasks are encoded, and whether skills
that the robot has are predicted as lessons are or measured in simulation. Settings name it as `predictor=…;skills=…`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from p2l.evaluation.rows import COLUMNS, Row, interval_row, table_of
from p2l.evaluation.statistics import Interval, paired_difference, t_interval
from p2l.evaluation.style import COST, label_ends, plain
from p2l.records import Array

METRICS = ("executed_cost", "predicted_cost", "demos", "delegated", "failures")
TRUTH = "adl_true"
COLOURS = ("#D55E00", "#E69F00", "#56B4E9", "#0072B2")
TRUTH_COLOUR = "#555555"


@dataclass(frozen=True)
class PredictorVariant:
    """One predictor's results.

    Attributes:
        encoding: of pairs of tasks.
        skills: `predicted` or `measured`, what is known of pre-trained skills.
        results: `team_results` rows of its plans.
        summary: `team_summary` rows.
        scores: rows of `evaluation.transfer.scores`, of the groups of pairs that are told of.
    """

    encoding: str
    skills: str
    results: pd.DataFrame
    summary: pd.DataFrame
    scores: Sequence[Mapping[str, Any]]

    @property
    def setting(self) -> str:
        """What it is, as part of a setting."""
        return f"predictor={self.encoding};skills={self.skills}"


def comparison(domain: str, variants: Sequence[PredictorVariant]) -> pd.DataFrame:
    """ADL with each variant and with the truth; the first variant is the one that the others are compared with.

    `executed_saving` is the first variant's executed cost minus this one's, `executed_price` this one's minus that of
    the plans made from the true transfer; both are paired by set. Scores have their interval over resampled tasks.
    """
    base = variants[0]
    rows: list[Row] = []
    for regime, level in sorted({(row[0], row[1]) for row in base.results[["regime", "level"]].to_numpy().tolist()}):
        case = f"regime={regime};pretrained={level}"
        true, first = (_costs(base, method, regime, level) for method in (TRUTH, "adl"))
        for variant in variants:
            setting = f"domain={domain};{variant.setting};{case}"
            rows += _means(variant, "adl", setting, regime, level)
            mine = _costs(variant, "adl", regime, level)
            if variant is not base:
                rows.append(interval_row("adl", setting, "executed_saving", paired_difference(first, mine)))
            rows.append(interval_row("adl", setting, "executed_price", paired_difference(mine, true)))
        rows += _means(base, TRUTH, f"domain={domain};{case}", regime, level)
    for variant in variants:
        for score in variant.scores:
            values = [np.nan if score[name] is None else float(score[name]) for name in ("mean", "low", "high")]
            mean, low, high = (np.asarray(value) for value in values)
            setting = f"domain={domain};{variant.setting};pairs={score['pairs']}"
            rows.append(
                interval_row(
                    str(score["method"]), setting, str(score["metric"]), Interval(mean, low, high, int(score["n"]))
                )
            )
    return table_of(rows).assign(thesis=np.nan)


def further_rows(variant: PredictorVariant, regime: str | None = None) -> pd.DataFrame:
    """Rows of all methods but the truth's for a table of costs against pre-training, of one regime or of both.

    Their settings are those of figure 3.7 (one regime) or 3.10 (both), with the variant's added.
    """
    mine = variant.summary[variant.summary["method"] != TRUTH]
    if regime is not None:
        mine = mine[mine["regime"] == regime]
    cases = [
        f"pretrained={level}" if regime is not None else f"regime={each};pretrained={level}"
        for each, level in zip(mine["regime"], mine["level"], strict=True)
    ]
    settings = [f"{case};{variant.setting}" for case in cases]
    table = mine.assign(setting=settings)[list(COLUMNS[:-1])].reset_index(drop=True)
    return table_of(table).assign(thesis=np.nan)


def predictor_figure(
    domains: Mapping[str, Sequence[PredictorVariant]], regime: str, names: Mapping[str, str]
) -> Figure:
    """Executed cost of ADL against pre-training with each variant and with the truth, a panel for each domain.

    Args:
        domains: title → variants.
        regime: of costs.
        names: a variant's setting → its label.
    """
    figure = Figure(figsize=(6.6 * len(domains), 4.6), layout="constrained")
    panels = figure.subplots(1, len(domains), sharey=True, squeeze=False)[0]
    labels = []
    for axes, (title, variants) in zip(panels, domains.items(), strict=True):
        lines = [
            (variant, "adl", names[variant.setting], colour) for variant, colour in zip(variants, COLOURS, strict=False)
        ]
        lines.append((variants[0], TRUTH, "true transfer", TRUTH_COLOUR))
        ends = []
        for variant, method, label, colour in lines:
            rows = variant.summary
            rows = rows[(rows["method"] == method) & (rows["regime"] == regime) & (rows["metric"] == "executed_cost")]
            level, mean, low, high = (
                rows.sort_values("level")[name].to_numpy(dtype=float) for name in ("level", "mean", "low", "high")
            )
            axes.fill_between(level, low, high, color=colour, alpha=0.12, lw=0)
            axes.plot(level, mean, "o-", color=colour, ms=4, lw=1.8)
            ends.append((float(level[-1]), float(mean[-1]), label, colour))
        labels.append(ends)
        axes.set(title=title, xlabel="number of pre-trained skills")
        plain(axes)
    panels[0].set_ylim(0.0, None)  # the panels share it, so only when all are drawn
    for axes, ends in zip(panels, labels, strict=True):
        label_ends(axes, ends)
    panels[0].set_ylabel(f"mean executed {COST} (95 % t intervals)")
    return figure


def _means(variant: PredictorVariant, method: str, setting: str, regime: str, level: int) -> list[Row]:
    case = _case(variant, method, regime, level)
    return [interval_row(method, setting, metric, t_interval(case[metric].to_numpy(dtype=float))) for metric in METRICS]


def _costs(variant: PredictorVariant, method: str, regime: str, level: int) -> Array:
    return np.asarray(_case(variant, method, regime, level)["executed_cost"].to_numpy(dtype=float))


def _case(variant: PredictorVariant, method: str, regime: str, level: int) -> pd.DataFrame:
    rows = variant.results
    return rows[(rows["method"] == method) & (rows["regime"] == regime) & (rows["level"] == level)].sort_values("set")

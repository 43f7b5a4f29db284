"""Readings: the claims of chapter 3 beside what our results give for each; every sentence is computed."""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd

from p2l.evaluation.page.page import Agreement, Reading
from p2l.evaluation.page.views import setting_label
from p2l.evaluation.style import METHODS, THESIS_METHODS

BASELINES = THESIS_METHODS[1:]
AS_WELL_PERCENT = 10.0  # "performs as well as" is read as: within so many percent
THETA_STEP = 0.05  # of the grid search


@dataclass(frozen=True)
class Cheapest:
    """At how many of `levels` ADL is cheaper than every baseline, or equal to the cheapest; see `cheapest`."""

    strict: int
    ties: int
    clear: int
    levels: int


def cheapest(summary: pd.DataFrame, regime: str, metric: str = "executed_cost") -> Cheapest:
    """Compare ADL with the baselines at each level; `clear`: its lead over each excludes zero (executed, paired)."""
    rows = summary[(summary["regime"] == regime) & summary["method"].isin(THESIS_METHODS)]
    means = rows[rows["metric"] == metric].pivot_table(index="level", columns="method", values="mean")
    lead = means.drop(columns="adl").min(axis=1) - means["adl"]
    low = rows[rows["metric"] == "excess_cost"].pivot_table(index="level", columns="method", values="low")
    equal = lead.abs() <= 1e-9 * means["adl"].abs()
    strict = (lead > 0) & ~equal
    clear = (low.min(axis=1) > 0).reindex(lead.index, fill_value=False)
    return Cheapest(int(strict.sum()), int(equal.sum()), int(clear.sum()), len(lead))


def read_cheapest(claim: str, summary: pd.DataFrame, regime: str) -> Reading:
    """ADL against the baselines at each level of pre-training."""
    execution, prediction = cheapest(summary, regime), cheapest(summary, regime, "predicted_cost")
    text = (
        f"ADL is the cheapest method at {execution.strict} of {execution.levels} levels{_ties(execution)} by executed "
        f"cost, at {prediction.strict} of {prediction.levels}{_ties(prediction)} by predicted cost; its executed lead "
        f"over every baseline has a 95 % interval above zero at {execution.clear}."
    )
    most = 2 * (execution.strict + execution.ties) > execution.levels
    return Reading(claim, text, _grade(execution.strict == execution.levels, most))


def read_gap(claim: str, summary: pd.DataFrame, regime: str) -> Reading:
    """ADL's lead over the cheapest baseline, without pre-training and with the most."""
    means = _means(summary, regime, "executed_cost")
    lead = means[list(BASELINES)].min(axis=1) - means["adl"]
    text = (
        f"ADL's lead over the cheapest baseline goes from {lead.iloc[0]:.0f} at {lead.index[0]} skills to "
        f"{lead.iloc[-1]:.0f} at {lead.index[-1]}."
    )
    return Reading(claim, text, _grade(lead.iloc[-1] < lead.iloc[0], False))


def read_convergence(claim: str, summary: pd.DataFrame, regime: str, n_tasks: float, level: int = 8) -> Reading:
    """Do ADL and AD become the same, fully autonomous robot at `level`?"""
    attempts, cost = _means(summary, regime, "attempts"), _means(summary, regime, "executed_cost")
    at = min(cost.index, key=lambda one: abs(one - level))
    shares = {method: float(attempts.loc[at, method]) / n_tasks for method in ("adl", "ad")}
    more = float(cost.loc[at, "ad"] / cost.loc[at, "adl"] - 1.0)
    text = (
        f"At {at} skills the robot attempts {shares['adl']:.0%} of the tasks under ADL and {shares['ad']:.0%} under "
        f"AD, and AD costs {100 * more:.1f} % more."
    )
    return Reading(claim, text, _grade(min(shares.values()) >= 0.95, abs(more) <= 0.05))


def read_crossing(claim: str, summary: pd.DataFrame, regime: str) -> Reading:
    """Where CBA(0.5) is cheaper than AD."""
    means = _means(summary, regime, "executed_cost")
    better = means["cba"] < means["ad"]
    where = ", ".join(str(level) for level in means.index[better]) or "no level"
    text = f"CBA(0.5) is cheaper than AD with these numbers of pre-trained skills: {where}; dearer or equal otherwise."
    return Reading(claim, text, _grade(bool(better.iloc[0]) and not better.iloc[-1], bool(better.iloc[0])))


def read_theta(claim: str, table: pd.DataFrame) -> Reading:
    """The threshold from the grid search beside the thesis's."""
    row = table[table["metric"] == "theta"].iloc[0]
    text = f"Grid search on sets that are not evaluated gives {row['mean']:.2f} (thesis {row['thesis']:g})."
    apart = abs(row["mean"] - row["thesis"])
    return Reading(claim, text, _grade(apart < 0.5 * THETA_STEP, apart < 2.5 * THETA_STEP))


def orders_that_differ(table: pd.DataFrame) -> list[str]:
    """Settings of table 3.1 in which a number is not the thesis's."""
    wrong = table["thesis"].notna() & (table["mean"] != table["thesis"])
    return list(dict.fromkeys(table.loc[wrong, "setting"]))


def read_orders(claim: str, table: pd.DataFrame) -> Reading:
    """Table 3.1 row by row, with the plan made from the true matrix where a row differs."""
    rows = table[table["thesis"].notna()]
    orders, bad = rows["setting"].nunique(), orders_that_differ(table)
    text = f"{orders - len(bad)} of {orders} rows are reproduced from the learnt predictor."
    true = table[table["method"] == "adl_true"].set_index(["setting", "metric"])["mean"]
    for row in rows[rows["mean"] != rows["thesis"]].to_dict("records"):
        text += (
            f" {row['setting']}: {row['metric']} {row['mean']:g} (thesis {row['thesis']:g}; with the true transfer "
            f"matrix {true[row['setting'], row['metric']]:g})."
        )
    return Reading(claim, text, _grade(not bad, 2 * len(bad) < orders))


def read_percent(claim: str, table: pd.DataFrame) -> Reading:
    """How much more than ADL the baselines cost, and whether the thesis's value lies in our interval."""
    rows = table[(table["metric"] == "percent_over_adl") & table["thesis"].notna()]
    parts = [
        f"{METHODS[row['method']].label} {row['mean']:.1f} % [{row['low']:.1f}, {row['high']:.1f}] "
        f"(thesis {row['thesis']:.1f} %)"
        for row in rows.to_dict("records")
    ]
    inside = (rows["low"] <= rows["thesis"]) & (rows["thesis"] <= rows["high"])
    return Reading(claim, "More than ADL: " + ", ".join(parts) + ".", _grade(bool(inside.all()), bool(inside.any())))


def read_low(claim: str, summary: pd.DataFrame, regime: str) -> Reading:
    """The largest excess of CBA and ALM over ADL where teaching is cheap."""
    means = _means(summary, regime, "executed_cost")
    more = {m: float((100 * (means[m] / means["adl"] - 1)).max()) for m in ("cba", "cba_best", "alm")}
    text = "At most, over the levels: " + ", ".join(
        f"{METHODS[method].label} {_percent(percent)} than ADL" for method, percent in more.items()
    )
    best = max(min(more["cba"], more["cba_best"]), more["alm"])
    text += f" ('as well' is read as within {AS_WELL_PERCENT:g} %)."
    return Reading(claim, text, _grade(max(more.values()) <= AS_WELL_PERCENT, best <= 2 * AS_WELL_PERCENT))


def read_high(claim: str, summary: pd.DataFrame, regime: str) -> Reading:
    """ADL's lead over each baseline where teaching is costly."""
    counts = cheapest(summary, regime)
    means = _means(summary, regime, "executed_cost").mean()
    parts = ", ".join(f"{METHODS[m].label} {_percent(100 * (means[m] / means['adl'] - 1))}" for m in BASELINES)
    text = (
        f"Averaged over the levels, than ADL: {parts}. ADL is cheapest at {counts.strict} of {counts.levels} levels"
        f"{_ties(counts)}, clearly (paired 95 % interval) at {counts.clear}."
    )
    return Reading(claim, text, _grade(counts.clear == counts.levels, counts.clear > 0))


def read_walls(claim: str, table: pd.DataFrame) -> Reading:
    """Success of skills on their own task with and without walls."""
    rate = {row["setting"].rpartition("=")[2]: row for row in table.to_dict("records")}
    with_walls, without = rate["kept"], rate["removed"]
    words = [f"{row['mean']:.1%} [{row['low']:.1%}, {row['high']:.1%}]" for row in (with_walls, without)]
    text = f"Success on the own task is {words[0]} with walls and {words[1]} once the walls are removed."
    return Reading(claim, text, _grade(with_walls["low"] > without["high"], False))


def read_scores(table: pd.DataFrame, pairs: str, domain: str) -> Reading:
    """The predictor beside the constant and the nearest neighbour."""
    rows = table[table["setting"].str.endswith(f"pairs={pairs}")]
    if rows.empty:
        return Reading("", f"{domain}: too few tasks were collected to judge {pairs.replace('_', ' ')} pairs.")
    scores = {key: float(row["mean"].iloc[0]) for key, row in rows.groupby(["method", "metric"])}
    briers = {method: scores[method, "brier"] for method in ("model", "nearest_neighbour", "constant")}
    best = min(briers, key=lambda method: briers[method])
    text = (
        f"{domain}: Brier score {briers['model']:.3f} (nearest neighbour {briers['nearest_neighbour']:.3f}, constant "
        f"{briers['constant']:.3f}), AUC {scores['model', 'auc']:.3f}; the best of the three by Brier score is the "
        f"{best.replace('_', ' ')}."
    )
    return Reading("", text)


def read_saving(table: pd.DataFrame, metric: str, what: str) -> Reading:
    """How often a paired difference is clear, and where it is largest."""
    rows = table[table["metric"] == metric]
    above, below = int((rows["low"] > 0).sum()), int((rows["high"] < 0).sum())
    largest = rows.sort_values("mean").iloc[-1]
    setting = setting_label(largest["setting"])
    text = (
        f"{what} in {above} of {len(rows)} settings with a 95 % interval above zero ({below} below zero); the largest "
        f"is {largest['mean']:.0f} [{largest['low']:.0f}, {largest['high']:.0f}] for {setting}."
    )
    return Reading("", text)


def _means(summary: pd.DataFrame, regime: str, metric: str) -> pd.DataFrame:
    rows = summary[(summary["regime"] == regime) & (summary["metric"] == metric)]
    return rows.pivot_table(index="level", columns="method", values="mean").sort_index()


def _ties(counts: Cheapest) -> str:
    return f" and equal to the cheapest at {counts.ties}" if counts.ties else ""


def _percent(value: float) -> str:
    return f"{abs(value):.1f} % {'more' if value >= 0 else 'less'}"


def _grade(full: bool, partly: bool) -> Agreement:
    return "yes" if full else "partly" if partly else "no"

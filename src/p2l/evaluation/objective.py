"""One objective for the three decision makers (thesis, eq. 1.2): what learning gained, what it cost, and the net.

A decision maker is judged against not learning: the team against its best plan that teaches nothing (`ad`), recovery
skills against carrying on (`open_loop`) and against the best of the heuristics, recovery policies against the nominal
skills alone. Everything is in the thesis's units of effort (section 3.5) and for as many tasks as learning serves: a
set of the team's study, whose demonstrations are for that set; `Prices.tasks` attempts of a task that failures, each
for `Prices.failure`, make dear. So in every row gain = without - with, and net = gain - learning_cost.

Deviations from the thesis:
    1. Chapters 4 and 5 name no c_learn. The prices here are ours, stated beside every net, and `pays_after` says from
       how many tasks on learning has paid at the stated price.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from p2l.evaluation.rows import Row, interval_row, single_row
from p2l.evaluation.statistics import Interval, paired_difference, t_interval

TEAM, SKILLS, POLICY = "team_plan", "recovery_skills", "recovery_policy"


@dataclass(frozen=True)
class Prices:
    """Prices in units of effort, and how many tasks what was trained serves.

    Attributes:
        failure: of a task that fails.
        query: of one query of REPS.
        control_step: of one simulated control step.
        tasks: that a trained recovery is there for.
    """

    failure: float
    query: float
    control_step: float
    tasks: float


def of_team(results: pd.DataFrame, setting: str, c_demo: float) -> list[Row]:
    """Rows of one case of the team's study: `adl` against `ad`, paired by set.

    Args:
        results: rows of `adl` and `ad`, one per set, with `executed_cost`, `demos` and `n_tasks`.
        setting: of the rows.
        c_demo: cost of a demonstration.
    """
    cost, demos = (results.pivot(index="set", columns="method", values=name) for name in ("executed_cost", "demos"))
    learning = demos["adl"].to_numpy() * c_demo
    without, total = cost["ad"].to_numpy(), cost["adl"].to_numpy()
    gain, served = paired_difference(without, total - learning), float(results["n_tasks"].mean())
    rows = [
        single_row(TEAM, setting, "served", served, len(total)),
        interval_row(TEAM, setting, "without", t_interval(without)),
        interval_row(TEAM, setting, "with", t_interval(total - learning)),
        interval_row(TEAM, setting, "gain", gain),
        interval_row(TEAM, setting, "demonstrations", t_interval(demos["adl"].to_numpy())),
        interval_row(TEAM, setting, "learning_cost", t_interval(learning)),
        interval_row(TEAM, setting, "net", paired_difference(without, total)),
    ]
    return [*rows, _pays_after(TEAM, setting, float(learning.mean()), gain, served)]


def of_skills(table_4_1: pd.DataFrame, world: str, queries: Sequence[int], prices: Prices) -> list[Row]:
    """Rows of recovery skills against carrying on, and against the heuristic that does best.

    Args:
        table_4_1: of `evaluate_recoveries`.
        world: its name.
        queries: that each training had.
        prices: of failures and queries.
    """
    cells = {(row["method"], row["setting"], row["metric"]): row for row in table_4_1.to_dict("records")}
    success = {method: row for (method, setting, metric), row in cells.items() if not setting and metric == "success"}
    gains = {
        setting.removeprefix("over="): row
        for (_, setting, metric), row in cells.items()
        if metric == "gain" and setting.startswith("over=")
    }
    if "recoveries" not in success or not gains:
        return []
    best = max(gains, key=lambda name: float(success[name]["mean"]))
    rows: list[Row] = []
    for instead in dict.fromkeys(name for name in ("open_loop", best) if name in gains):
        setting = f"world={world};instead={instead}"
        before, after = (_failures(success[name], prices) for name in (instead, "recoveries"))
        gain = _scaled(gains[instead], prices.tasks * prices.failure)
        rows += _trained(SKILLS, setting, before, after, gain, ("queries", queries, prices.query), prices)
    return rows


def of_policies(success: pd.DataFrame, world: str, steps: Sequence[float], prices: Prices) -> list[Row]:
    """Rows of a recovery policy against the nominal skills alone, paired by training.

    Args:
        success: [S] trainings with the columns `rc` and `nominal`: success rates on the same start states.
        world: its name.
        steps: control steps that each training simulated.
        prices: of failures and steps.
    """
    all_fail, setting = prices.tasks * prices.failure, f"world={world};instead=nominal"
    before, after = (all_fail * (1.0 - success[name].to_numpy(dtype=float)) for name in ("nominal", "rc"))
    gain = paired_difference(before, after)
    spent = ("control_steps", steps, prices.control_step)
    return _trained(POLICY, setting, t_interval(before), t_interval(after), gain, spent, prices)


def _trained(
    maker: str,
    setting: str,
    before: Interval,
    after: Interval,
    gain: Interval,
    spent: tuple[str, Sequence[float], float],
    prices: Prices,
) -> list[Row]:
    """Rows of what is trained in simulation; `spent` is the unit, its number in each training, and its price."""
    unit, numbers, price = spent
    amount = t_interval(np.asarray(numbers, dtype=float))
    learning = Interval(price * amount.mean, price * amount.low, price * amount.high, amount.n)
    net = Interval(gain.mean - learning.mean, gain.low - learning.mean, gain.high - learning.mean, gain.n)
    return [
        single_row(maker, setting, "served", prices.tasks, amount.n),
        interval_row(maker, setting, "without", before),
        interval_row(maker, setting, "with", after),
        interval_row(maker, setting, "gain", gain),
        interval_row(maker, setting, unit, amount),
        interval_row(maker, setting, "learning_cost", learning),
        interval_row(maker, setting, "net", net),
        _pays_after(maker, setting, float(learning.mean), gain, prices.tasks),
    ]


def _pays_after(maker: str, setting: str, learning_cost: float, gain: Interval, served: float) -> Row:
    """Tasks from which on the gain is above what learning cost; infinite where nothing is gained."""
    tasks = served * learning_cost / float(gain.mean) if gain.mean > 0.0 else np.inf
    return single_row(maker, setting, "pays_after", tasks, gain.n)


def _scaled(row: dict[Any, Any], by: float) -> Interval:
    mean, low, high = (np.asarray(by * float(row[name])) for name in ("mean", "low", "high"))
    return Interval(mean, low, high, int(row["n"]))


def _failures(row: dict[Any, Any], prices: Prices) -> Interval:
    """What the failures of all tasks cost at a success rate."""
    cost = prices.tasks * prices.failure
    mean, low, high = (np.asarray(cost * (1.0 - float(row[name]))) for name in ("mean", "high", "low"))
    return Interval(mean, low, high, int(row["n"]))

"""The report of `learn_recoveries`: tables, figures, headline numbers, and notes on modes without a recovery."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from p2l.artifacts import finite, save_json
from p2l.evaluation.metareskill.figures import allocation_figure, graph_figure, value_figure
from p2l.evaluation.metareskill.rounds import (
    Histories,
    Values,
    allocation_table,
    comparison_table,
    queries_table,
    rounds_table,
    value_table,
)
from p2l.evaluation.sheets import StageReport, save_sheets
from p2l.metareskill.history import hopeless
from p2l.metareskill.ledger import Ledger
from p2l.metareskill.setting import Setting


def learning_report(
    out: Path,
    item: str,
    setting: Setting,
    histories: Histories,
    reported: Values,
    ledgers: Mapping[int, Ledger],
    choosers: Sequence[str],
    episodes: int,
) -> StageReport:
    """Write the tables of rounds, queries, figures 4.6 and 4.7 and choosers, the figures, the graphs and summary.json.

    Args:
        out: folder.
        item: the world's name, for titles.
        setting: shared by all.
        histories: by (seed, chooser).
        reported: values to report of them, see `metareskill.reported`.
        ledgers: by seed, with the queries of all choosers.
        choosers: the first one's skills are kept.
        episodes: trainings in a round.
    """
    targets, first = setting.task.targets, choosers[0]
    values = value_table(reported)
    allocation = allocation_table(histories, targets)
    comparison = comparison_table(values, first)
    tables = {
        "rounds": rounds_table(histories, reported, targets),
        "queries": (asked := queries_table(histories, ledgers, targets, episodes)),
        "figure_4_6": allocation,
        "figure_4_7": values,
        "choosers": comparison,
    }
    figures = {
        "figure_4_6": allocation_figure(values, allocation, choosers[:2], f"{item}: rounds of training"),
        "figure_4_7": value_figure(values, f"{item}: value of failures while recoveries are trained"),
    }
    for (seed, chooser), history in histories.items():
        if chooser == first:
            graph = setting.graph.with_q(history.best)
            title = f"{item}: seed {seed}, {chooser}"
            figures[f"graphs/s{seed}"] = graph_figure(graph, history.counts, targets, title)
    save_sheets(out, tables, figures)
    facts = _facts(setting, histories, reported, values, comparison)
    facts["kl_nats"] = finite(float(asked["kl_nats"].median()))
    save_json(out / "summary.json", facts, schema="learn_summary", version=1)
    metrics = {f"value/{name}": float(value) for name, value in facts["final_value"].items()}
    files = (*(out / f"{name}.png" for name in figures), out / "rounds.csv")
    return StageReport({**metrics, "solved": facts["solved"]}, files, tuple(_notes(setting, histories)))


def _facts(
    setting: Setting, histories: Histories, reported: Values, values: pd.DataFrame, comparison: pd.DataFrame
) -> dict[str, Any]:
    final = values[values["queries"] == values["queries"].max()].groupby("chooser", sort=False)["value"].mean()
    successes = [each.solved for history in histories.values() for each in history.rounds]
    against = {
        str(other): {"better": int(group["better"].sum()), "seeds": len(group), "shares": _plain(group["share"])}
        for other, group in comparison.groupby("other")
    }
    return {
        "failures": len(setting.failures.mode),
        "held_out": len(setting.held_out.mode),
        "sizes": setting.graph.sizes.tolist(),
        "final_value": {str(name): float(value) for name, value in final.items()},
        "optimism": {str(name): _optimism(histories, reported, str(name)) for name in final.index},
        "solved": float(np.mean(successes)),
        "against": against,
    }


def _optimism(histories: Histories, reported: Values, chooser: str) -> float:
    """By how much the final value that a chooser saw is above the reported one, mean over seeds."""
    ends = [history.values[-1] - reported[key][-1] for key, history in histories.items() if key[1] == chooser]
    return float(np.mean(ends))


def _plain(column: pd.Series[float]) -> list[float | None]:
    return [finite(value) for value in column.tolist()]


def _notes(setting: Setting, histories: Histories) -> list[str]:
    """Notes on modes none of whose recoveries ever succeeded."""
    lines = []
    for (seed, chooser), history in histories.items():
        for mode in hopeless(history).tolist():
            share = f"{setting.graph.share[mode]:.0%}"
            lines.append(f"Seed {seed}, {chooser}: no recovery from mode {mode} ({share} of failures) ever succeeded.")
    return lines

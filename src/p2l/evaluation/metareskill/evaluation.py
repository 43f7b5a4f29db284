"""The report of `evaluate_recoveries`: tables 4.1 and 4.2, success within so many skills, figures 4.6 and 4.7."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from p2l.artifacts import finite, save_json
from p2l.errors import ArtifactError
from p2l.evaluation.metareskill import curves
from p2l.evaluation.metareskill.tables import TABLE_4_1, TABLE_4_2, table_4_1, table_4_2
from p2l.evaluation.metareskill.within import TABLE as WITHIN
from p2l.evaluation.metareskill.within import draw_within, success_within
from p2l.evaluation.sheets import StageReport, load_sheet, save_sheets
from p2l.evaluation.thesis import Thesis, load_thesis
from p2l.metareskill.record import Recoveries
from p2l.metareskill.strategy_names import RECOVERIES
from p2l.metareskill.value_iteration import value_of_failures
from p2l.seeding import generator

CHAPTER = 4
_ROUNDS = ("seed", "chooser", "round", "mode", "target_name", "q_after", "value_reported")


@dataclass(frozen=True)
class RecoveryEvaluation:
    """The episodes of an evaluation, and the recoveries and rounds of training behind them.

    Attributes:
        item: for titles.
        episodes: of `p2l.metareskill.episodes`.
        unseen: settings of table 4.2 behind the row `handle=unseen`, doors that recoveries were not trained on.
        recoveries: by seed.
        rounds: `rounds.csv` of `learn_recoveries`.
    """

    item: str
    episodes: pd.DataFrame
    unseen: Sequence[str]
    recoveries: Mapping[int, Recoveries]
    rounds: pd.DataFrame


def read_rounds(path: Path, seeds: Sequence[int]) -> pd.DataFrame:
    """The rows of `rounds.csv` of some seeds.

    Raises:
        ArtifactError: the file, a column or one of the seeds is missing.
    """
    table = load_sheet(path, _ROUNDS, "run `python -m stages.learn_recoveries`")
    if absent := sorted(set(seeds) - set(table["seed"])):
        raise ArtifactError(f"{path}: holds no round of seeds {absent}; learn recoveries with them")
    return table[table["seed"].isin(seeds)]


def evaluation_report(out: Path, evaluation: RecoveryEvaluation, thesis: Path, seed: int) -> StageReport:
    """Write the tables as CSV, the figures as PNG, and summary.json.

    Args:
        out: folder.
        evaluation: episodes, recoveries and rounds to report.
        thesis: folder of the thesis's numbers.
        seed: of the bootstrap.
    """
    tables = _tables(evaluation, load_thesis(thesis, CHAPTER), seed)
    figures = {
        "figure_4_6": curves.draw_4_6(tables["figure_4_6"], f"{evaluation.item}: rounds of training"),
        "figure_4_7": curves.draw_4_7(
            tables["figure_4_7"], f"{evaluation.item}: value of failures while recoveries are trained"
        ),
        WITHIN: draw_within(tables[WITHIN], f"{evaluation.item}: success against the skills and the way it took"),
    }
    save_sheets(out, tables, figures)
    metrics = _headline(tables)
    save_json(out / "summary.json", {"headline": metrics}, schema="recovery_evaluation", version=1)
    files = (*(out / f"{name}.csv" for name in tables), *(out / f"{name}.png" for name in figures))
    return StageReport(
        {name: value for name, value in metrics.items() if value is not None}, files, tuple(_notes(evaluation))
    )


def curve_tables(evaluation: RecoveryEvaluation) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Values `seed, chooser, queries, value`, and allocation `seed, chooser, mode, target, trained, q`."""
    rounds, graph = evaluation.rounds, next(iter(evaluation.recoveries.values())).graph
    before = float(value_of_failures(graph, np.zeros_like(graph.q)))
    starts = rounds[["seed", "chooser"]].drop_duplicates().assign(queries=0, value=before)
    after = rounds[["seed", "chooser", "round", "value_reported"]].rename(
        columns={"round": "queries", "value_reported": "value"}
    )
    values = pd.concat([starts, after], ignore_index=True)
    names = dict(zip(rounds["target"], rounds["target_name"], strict=True))
    every = pd.MultiIndex.from_product([range(graph.q.shape[0]), range(graph.q.shape[1])], names=["mode", "target"])
    parts = []
    for (seed, chooser), own in rounds.groupby(["seed", "chooser"], sort=False):
        counts = own.groupby(["mode", "target"])["q_after"].agg(trained="size", q="max").reindex(every, fill_value=0)
        part = counts.reset_index().assign(seed=int(str(seed)), chooser=str(chooser))
        parts.append(part.assign(target=[names.get(number, str(number)) for number in part["target"]]))
    return values, pd.concat(parts, ignore_index=True)


def _tables(evaluation: RecoveryEvaluation, thesis: Thesis, seed: int) -> dict[str, pd.DataFrame]:
    episodes = evaluation.episodes
    plain = episodes["setting"] == ""
    values, allocation = curve_tables(evaluation)
    choosers = list(dict.fromkeys(values["chooser"]))
    rng = {name: generator(seed, "bootstrap", name) for name in (TABLE_4_1, TABLE_4_2)}
    return {
        "table_4_1": table_4_1(episodes[plain], thesis, rng[TABLE_4_1]),
        "table_4_2": table_4_2(episodes[~plain], evaluation.unseen, thesis, rng[TABLE_4_2]),
        WITHIN: success_within(episodes[plain], thesis),
        "figure_4_6": curves.figure_4_6(values, allocation, choosers[:2], thesis),
        "figure_4_7": curves.figure_4_7(values, choosers[0], thesis),
    }


def _headline(tables: Mapping[str, pd.DataFrame]) -> dict[str, float | None]:
    """Pooled success rates and gains, without those of single seeds."""
    rows: dict[str, float | None] = {}
    for name, metrics in (
        ("table_4_1", ("success", "gain")),
        ("table_4_2", ("success", "gain")),
        ("figure_4_7", ("better",)),
    ):
        table = tables.get(name)
        if table is None:
            continue
        selection = table[table["metric"].isin(metrics) & ~table["setting"].str.startswith("seed=")]
        for row in selection.to_dict("records"):
            parts = [part.replace("=", "_") for part in str(row["setting"]).split(";") if part]
            rows["/".join([name, str(row["method"]), *parts, str(row["metric"])])] = finite(row["mean"])
    return rows


def _notes(evaluation: RecoveryEvaluation) -> list[str]:
    """Notes on seeds without a feasible recovery, and on diverged simulations."""
    lines = [
        f"Seed {seed}: no recovery is feasible, so that '{RECOVERIES}' gives up wherever no precondition holds."
        for seed, recoveries in evaluation.recoveries.items()
        if not (recoveries.graph.q > 0.0).any()
    ]
    episodes = evaluation.episodes
    if divergences := int(episodes["diverged"].sum()):
        lines.append(f"The simulation of {divergences} of {len(episodes)} episodes broke down; they are left out.")
    return lines

"""The report of `evaluate_recoveries`: tables 4.1 and 4.2, success within so many skills, figures 4.6 and 4.7."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

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
from p2l.seeding import generator

CHAPTER = 4
_VALUES = ("seed", "chooser", "queries", "value")
_ALLOCATION = ("seed", "chooser", "mode", "target", "trained", "q")


@dataclass(frozen=True)
class RecoveryEvaluation:
    """The episodes of an evaluation, and the recoveries and the training behind them.

    Attributes:
        item: for titles.
        episodes: of `p2l.metareskill.episodes`.
        unseen: settings of table 4.2 behind the row `handle=unseen`, doors that recoveries were not trained on.
        recoveries: by seed.
        values: value of failures after each query, see `evaluation.metareskill.rounds.value_table`.
        allocation: how often each recovery was trained, see `rounds.allocation_table`.
    """

    item: str
    episodes: pd.DataFrame
    unseen: Sequence[str]
    recoveries: Mapping[int, Recoveries]
    values: pd.DataFrame
    allocation: pd.DataFrame


def read_curves(folder: Path, seeds: Sequence[int]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """`figure_4_7.csv` and `figure_4_6.csv` of `learn_recoveries`, the rows of some seeds.

    Raises:
        ArtifactError: a file, a column or one of the seeds is missing.
    """
    tables = []
    for name, columns in (("figure_4_7", _VALUES), ("figure_4_6", _ALLOCATION)):
        path = folder / f"{name}.csv"
        table = load_sheet(path, columns, "run `python -m stages.learn_recoveries`")
        if absent := sorted(set(seeds) - set(table["seed"])):
            raise ArtifactError(f"{path}: holds nothing of seeds {absent}; learn recoveries with them")
        tables.append(table[table["seed"].isin(seeds)])
    return tables[0], tables[1]


def evaluation_report(out: Path, evaluation: RecoveryEvaluation, thesis: Path, seed: int) -> StageReport:
    """Write the tables as CSV, the figures as PNG, and summary.json.

    Args:
        out: folder.
        evaluation: episodes, recoveries and curves to report.
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


def _tables(evaluation: RecoveryEvaluation, thesis: Thesis, seed: int) -> dict[str, pd.DataFrame]:
    episodes = evaluation.episodes
    plain = episodes["setting"] == ""
    values, allocation = evaluation.values, evaluation.allocation
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

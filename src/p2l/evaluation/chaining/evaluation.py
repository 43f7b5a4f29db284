"""The report of `evaluate_chains`: tables, figures 5.5, 5.8 and 5.9, headline numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from p2l.artifacts import finite, save_json
from p2l.errors import ArtifactError
from p2l.evaluation.chaining import tables
from p2l.evaluation.chaining.ablation import OWN, ablation_5
from p2l.evaluation.chaining.ablation import TABLE as ABLATION
from p2l.evaluation.chaining.elsewhere import TABLE as TRANSFERS
from p2l.evaluation.chaining.elsewhere import table_5_2
from p2l.evaluation.chaining.figures import MAIN, learning_curves, option_counts
from p2l.evaluation.chaining.rates import totals
from p2l.evaluation.chaining.reuse import TABLE as REUSE
from p2l.evaluation.chaining.reuse import figure_5_9, novel_starts
from p2l.evaluation.chaining.strategies import TABLE as STRATEGIES
from p2l.evaluation.chaining.strategies import strategies_5
from p2l.evaluation.sheets import aggregates, load_sheet, save_sheets
from p2l.evaluation.thesis import load_thesis

CHAPTER = 5
STEPS = "steps_to_thesis"
_COLUMNS = {"rounds": ("learner", "seed", "round"), "evaluations": ("learner", "seed", "control_steps", "success")}


@dataclass(frozen=True)
class ChainEvaluation:
    """Evaluation of policies in one world, and their training runs.

    Attributes:
        item: the world, or a variant of it.
        episodes: rows of `p2l.chaining.episodes`.
        runs: of `chain_recoveries`.
        transfers: rows of `p2l.chaining.elsewhere.transfer_of_seed`.
        reuse: rows of `p2l.chaining.reuse`.
        ablation: rows of `p2l.chaining.episodes`, by variant of the world.
    """

    item: str
    episodes: pd.DataFrame
    runs: Sequence[tables.Learning]
    transfers: pd.DataFrame
    reuse: pd.DataFrame
    ablation: Mapping[str, pd.DataFrame] = field(default_factory=dict)


def read_runs(folder: Path, learners: Sequence[str], seeds: Sequence[int]) -> list[tables.Learning]:
    """Learning curves of the evaluated policies, from `rounds.csv` and `evaluations.csv`.

    Raises:
        ArtifactError: a file, a column or a run is missing.
    """
    alone = not (folder / "policies").is_dir()
    again = f"learn them anew with `python -m stages.chain_recoveries`{'' if alone else ' and compare=[…]'}"
    advice = f"it is what a finished run leaves beside its policy; put it back, or {again}"
    sheets = {name: load_sheet(folder / f"{name}.csv", columns, advice) for name, columns in _COLUMNS.items()}
    runs = []
    for learner in learners:
        for seed in seeds:
            parts = {name: _of(table, learner, seed) for name, table in sheets.items()}
            if not all(len(part) for part in parts.values()):
                raise ArtifactError(
                    f"{folder}: holds no curves of {learner}, seed {seed}; run `python -m stages.chain_recoveries` "
                    f"with compare=[{learner}] seeds=[{seed}]"
                )
            runs.append(tables.Learning(learner, seed, parts["rounds"], parts["evaluations"]))
    return runs


def chain_report(out: Path, evaluation: ChainEvaluation, thesis: Path) -> tuple[dict[str, float], list[Path]]:
    """Write the tables as CSV, the figures as PNG, and summary.json.

    Args:
        out: folder.
        evaluation: what to report.
        thesis: folder of the thesis's numbers.

    Returns:
        headline numbers, and the files.
    """
    reference, runs = load_thesis(thesis, CHAPTER), {evaluation.item: evaluation.runs}
    sheets = {tables.TABLE: tables.table_5_1({evaluation.item: evaluation.episodes}, reference, runs)}
    sheets[TRANSFERS] = table_5_2(evaluation.item, evaluation.transfers, reference)
    varied = {learner for table in evaluation.ablation.values() for learner in table["learner"]}
    own = {OWN: evaluation.episodes[evaluation.episodes["learner"].isin(varied)]}
    sheets[ABLATION] = ablation_5(evaluation.item, {**own, **evaluation.ablation}, reference)
    sheets[STRATEGIES] = strategies_5(evaluation.item, evaluation.reuse, reference)
    sheets[REUSE] = figure_5_9(evaluation.item, evaluation.reuse, reference)
    sheets[tables.CURVES] = tables.figure_5_5(runs, reference)
    sheets[tables.OPTIONS] = tables.figure_5_8(runs, reference)
    sheets[STEPS] = tables.steps_to_thesis(sheets[tables.TABLE], runs, reference)
    figures = {
        tables.CURVES: learning_curves(sheets[tables.CURVES]),
        tables.OPTIONS: option_counts(sheets[tables.OPTIONS], evaluation.item, MAIN),
        REUSE: novel_starts(sheets[REUSE], evaluation.item, MAIN),
    }
    save_sheets(out, sheets, figures)
    facts = {str(learner): totals(part) for learner, part in evaluation.episodes.groupby("learner", sort=False)}
    save_json(out / "summary.json", {"learners": facts}, schema="chain_evaluation", version=1)
    numbers = {f"{learner}/{name}": one["mean"] for learner, part in facts.items() for name, one in part.items()}
    for row in aggregates(sheets[TRANSFERS]).to_dict("records"):
        if row["metric"] == "recovery":
            numbers[f"{row['method']}/{str(row['setting']).rpartition('=')[2]}/recovery"] = row["mean"]
    files = [*(out / f"{name}.csv" for name in sheets), *(out / f"{name}.png" for name in figures)]
    return {name: value for name, value in numbers.items() if finite(value) is not None}, files


def evaluation_line(episodes: pd.DataFrame) -> str:
    """Overall success of every learner, for a person: with 95 % intervals, the nominal skills first."""
    parts: list[str] = []
    for learner, part in episodes.groupby("learner", sort=False):
        rates = totals(part)
        if "nominal" in rates and not parts:
            parts.append(f"nominal {_rate(rates['nominal'])}")
        parts.append(f"{learner} {_rate(rates['success'])}")
    return f"success {', '.join(parts)}, of {part['episode'].nunique()} episodes for each policy"


def _rate(row: Mapping[str, Any]) -> str:
    return f"{row['mean']:.1%} ({row['low']:.1%} to {row['high']:.1%})"


def _of(table: pd.DataFrame, learner: str, seed: int) -> pd.DataFrame:
    """One run's rows, without the columns of other learners' actions."""
    rows = table[(table["learner"] == learner) & (table["seed"] == seed)]
    return rows.dropna(axis=1, how="all").reset_index(drop=True)

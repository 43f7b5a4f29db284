"""What `evaluate_chains` leaves for people: tables, figures 5.5, 5.8 and 5.9, headline numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from p2l.artifacts import finite, save_json
from p2l.errors import ArtifactError
from p2l.evaluation.chaining import tables
from p2l.evaluation.chaining.ablation import OWN, ablation_5
from p2l.evaluation.chaining.ablation import TABLE as ABLATION
from p2l.evaluation.chaining.elsewhere import TABLE as TRANSFERS
from p2l.evaluation.chaining.elsewhere import table_5_2
from p2l.evaluation.chaining.figures import MAIN, learning_curves, options_tried
from p2l.evaluation.chaining.rates import totals
from p2l.evaluation.chaining.reuse import TABLE as REUSE
from p2l.evaluation.chaining.reuse import figure_5_9, novel_starts
from p2l.evaluation.chaining.strategies import TABLE as STRATEGIES
from p2l.evaluation.chaining.strategies import strategies_5
from p2l.evaluation.sheets import load_sheet, pooled, save_sheets
from p2l.evaluation.thesis import load_thesis

CHAPTER = 5
STEPS = "steps_to_thesis"
_NEEDED = {"rounds": ("learner", "seed", "round"), "evaluations": ("learner", "seed", "control_steps", "success")}


@dataclass(frozen=True)
class ChainEvaluation:
    """All that was run in one world, and how it was learnt.

    Attributes:
        item: the world, or a variant of it.
        episodes: of `chain_episodes`.
        runs: of `chain_recoveries`.
        transfers: of `chain_transfer.transfer_of_seed`.
        reuse: of `chain_reuse`.
        ablation: of `chain_episodes`, by variant, each learnt and judged in itself.
    """

    item: str
    episodes: pd.DataFrame
    runs: Sequence[tables.Learning]
    transfers: pd.DataFrame
    reuse: pd.DataFrame
    ablation: Mapping[str, pd.DataFrame] = field(default_factory=dict)


def read_runs(folder: Path, learners: Sequence[str], seeds: Sequence[int]) -> list[tables.Learning]:
    """Curves of the runs that are evaluated, from `rounds.csv` and `evaluations.csv`.

    Raises:
        ArtifactError: missing, without a needed column, or without one of the runs.
    """
    advice = "run `python -m stages.chain_recoveries` with compare=[…]"
    found = {name: load_sheet(folder / f"{name}.csv", columns, advice) for name, columns in _NEEDED.items()}
    runs = []
    for learner in learners:
        for seed in seeds:
            parts = {name: _of(table, learner, seed) for name, table in found.items()}
            if not all(len(part) for part in parts.values()):
                raise ArtifactError(
                    f"{folder}: holds no curves of {learner}, seed {seed}; run `python -m stages.chain_recoveries` "
                    f"with compare=[{learner}] seeds=[{seed}]"
                )
            runs.append(tables.Learning(learner, seed, parts["rounds"], parts["evaluations"]))
    return runs


def chain_report(out: Path, found: ChainEvaluation, thesis: Path) -> tuple[dict[str, float], list[Path]]:
    """Write the tables as CSV, the figures as PNG, and summary.json.

    Returns:
        headline numbers, and the files.
    """
    told, runs = load_thesis(thesis, CHAPTER), {found.item: found.runs}
    made = {tables.TABLE: tables.table_5_1({found.item: found.episodes}, told)}
    made[TRANSFERS] = table_5_2(found.item, found.transfers, told)
    own = {OWN: found.episodes[found.episodes["learner"] == MAIN]}
    made[ABLATION] = ablation_5(found.item, {**own, **found.ablation}, told)
    made[STRATEGIES] = strategies_5(found.item, found.reuse, told)
    made[REUSE] = figure_5_9(found.item, found.reuse, told)
    made[tables.CURVES] = tables.figure_5_5(runs, told)
    made[tables.TRIED] = tables.figure_5_8(runs, told)
    made[STEPS] = tables.steps_to_thesis(made[tables.TABLE], runs, told)
    figures = {
        tables.CURVES: learning_curves(made[tables.CURVES]),
        tables.TRIED: options_tried(made[tables.TRIED], found.item, MAIN),
        REUSE: novel_starts(made[REUSE], found.item, MAIN),
    }
    save_sheets(out, made, figures)
    facts = {str(learner): totals(part) for learner, part in found.episodes.groupby("learner", sort=False)}
    save_json(out / "summary.json", {"learners": facts}, schema="chain_evaluation", version=1)
    numbers = {f"{learner}/{name}": one["mean"] for learner, part in facts.items() for name, one in part.items()}
    for row in pooled(made[TRANSFERS]).to_dict("records"):
        if row["metric"] == "recovery":
            numbers[f"{row['method']}/{str(row['setting']).rpartition('=')[2]}/recovery"] = row["mean"]
    files = [*(out / f"{name}.csv" for name in made), *(out / f"{name}.png" for name in figures)]
    return {name: value for name, value in numbers.items() if finite(value) is not None}, files


def _of(table: pd.DataFrame, learner: str, seed: int) -> pd.DataFrame:
    """One run's rows; columns of other learners' actions go."""
    rows = table[(table["learner"] == learner) & (table["seed"] == seed)]
    return rows.dropna(axis=1, how="all").reset_index(drop=True)

"""Predictions that plans rely on: the pairs of skill and task where a plan lets the robot act (thesis, section 3.5).

A planner picks the skills that promise most, so the pairs that it uses are alike in prediction, and optimistic ones are
among them more often than among all pairs. How well a predictor ranks those is what a plan's cost depends on.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from p2l.artifacts import save_json
from p2l.evaluation.transfer.scores import Predictions, records, score_table
from p2l.records import Array
from p2l.team.execute import Truth

GROUP = "planned"


def planned_report(
    out: Path, plans: pd.DataFrame, truths: Mapping[int, Truth], draws: int, rng: np.random.Generator
) -> None:
    """Write predictions.json, the scores of `planned_predictions`; `rng` resamples tasks for the intervals."""
    scores = score_table([planned_predictions(plans, truths, draws)], rng)
    save_json(out / "predictions.json", {"scores": records(scores)}, schema="planned_predictions", version=1)


def planned_predictions(
    plans: pd.DataFrame,
    truths: Mapping[int, Truth],
    draws: int,
    method: str = "adl",
    tables: Mapping[int, Array] | None = None,
) -> Predictions:
    """Every pair of skill and task on which some plan of `method` acts, once, with the executing draws of the truth.

    Args:
        plans: rows of `team.execute.plan_rows`.
        truths: by block.
        draws: behind an executing success rate.
        method: whose plans; they were made with the predictor.
        tables: by block, probabilities [S, M] of another predictor, which is judged on the pairs of these plans.
    """
    acts = plans[(plans["method"] == method) & (plans["decision"] == "act") & (plans["skill"] >= 0)]
    pairs = acts.drop_duplicates(["block", "skill", "task"]).sort_values(["block", "skill", "task"])
    block, skill, task = (pairs[name].to_numpy(dtype=np.int64) for name in ("block", "skill", "task"))
    places = list(zip(block.tolist(), skill.tolist(), task.tolist(), strict=True))
    rates = [truths[index].executing[row, column] for index, row, column in places]
    p = pairs["p_success"].to_numpy(dtype=np.float64)
    if tables is not None:
        p = np.array([tables[index][row, column] for index, row, column in places], dtype=np.float64)
    number = block * (
        1 + max((len(truth.executing) for truth in truths.values()), default=0)
    )  # of a block's first task
    return Predictions(
        method="model",
        pairs=GROUP,
        p=p,
        successes=np.rint(np.array(rates, dtype=np.float64) * draws).astype(np.int64),
        draws=draws,
        train_task=number + skill,
        test_task=number + task,
    )

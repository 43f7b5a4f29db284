"""Table 5.1 and the data of figures 5.5 and 5.8, as long tables beside the thesis's numbers.

Columns are those of `evaluation.rows`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from p2l.evaluation.chaining.figures import BESIDE_MAIN, MAIN
from p2l.evaluation.chaining.rates import totals
from p2l.evaluation.rows import Row, interval_row, single_row, table_of
from p2l.evaluation.statistics import paired_difference, t_interval
from p2l.evaluation.thesis import Thesis

BUDGET = 500_000  # control steps that the thesis gives every learner
TABLE, CURVES, OPTIONS = "table_5_1", "figure_5_5", "figure_5_8"


@dataclass(frozen=True)
class Learning:
    """One run of `chain_recoveries`.

    Attributes:
        learner, seed: which.
        rounds: one row per rollout.
        evaluations: one row per evaluation.
    """

    learner: str
    seed: int
    rounds: pd.DataFrame
    evaluations: pd.DataFrame


def table_5_1(
    episodes: Mapping[str, pd.DataFrame], thesis: Thesis, runs: Mapping[str, Iterable[Learning]] | None = None
) -> pd.DataFrame:
    """Overall success of every learner in every world, beside the nominal skills.

    Intervals are `statistics.rate_interval`'s; those of the nominal skills, which no training changes, are Wilson's.
    `recovery` counts only episodes that were flagged, and is left out for learners of the whole task.
    `success_minus_rc` is a learner's rate less that of RC on the same start states: mean and t limits of the seeds'
    differences. Rows with a seed have the rates of its episodes. For `runs` see `_of_training`.
    """
    rows: list[Row] = []
    for world, table in episodes.items():
        setting = f"world={world}"
        for learner, part in table.groupby("learner", sort=False):
            rates = totals(part)
            names = [name for name in ("success", "recovery") if name in rates]
            rows += [_of(str(learner), setting, name, rates[name]) for name in names]
            for seed, own in part.groupby("seed"):
                alone = totals(own)
                rows += [_of(str(learner), f"{setting};seed={seed}", name, alone[name]) for name in names]
        rows += _beside_main(table, setting)
        recovering = table[~table["whole_task"]]
        if len(recovering):
            first = recovering[recovering["learner"] == recovering["learner"].iloc[0]]
            rows.append(_of("nominal", setting, "success", totals(first)["nominal"]))
            for seed, own in first.groupby("seed"):
                rows.append(_of("nominal", f"{setting};seed={seed}", "success", totals(own)["nominal"]))
        rows += _of_training((runs or {}).get(world, ()), setting)
    return thesis.beside(table_of(rows), TABLE)


def _of_training(runs: Iterable[Learning], setting: str) -> list[Row]:
    """What the trainings of every learner were given, over seeds, and each seed.

    `revisited` is the share of their episodes that started at earlier successes, `control_steps` how many they
    simulated, `spared` the share of their budget that was not simulated. Records from before `spared` lack it.
    """
    rows: list[Row] = []
    for learner, own in _by_learner(runs).items():
        values: dict[str, dict[int, float]] = {}
        for run in own:
            if "revisited" in run.rounds:
                again, fresh = float(run.rounds["revisited"].sum()), float(run.rounds["ended"].sum())
                values.setdefault("revisited", {})[run.seed] = again / max(again + fresh, 1.0)
            steps = float(run.rounds["control_steps"].iloc[-1])
            values.setdefault("control_steps", {})[run.seed] = steps
            if "spared" in run.rounds:
                spared = float(run.rounds["spared"].iloc[-1])
                values.setdefault("spared", {})[run.seed] = spared / max(steps + spared, 1.0)
        for name, by_seed in values.items():
            interval = t_interval(list(by_seed.values()))
            rows.append(interval_row(learner, setting, name, replace(interval, low=np.maximum(interval.low, 0.0))))
            rows += [single_row(learner, f"{setting};seed={seed}", name, value) for seed, value in by_seed.items()]
    return rows


def _beside_main(table: pd.DataFrame, setting: str) -> list[Row]:
    """Every other learner against `MAIN`, paired by seed; episodes that broke down for either are left out of both."""
    sound = table[~table["diverged"]].pivot(index=["seed", "episode"], columns="learner", values="success")
    rows: list[Row] = []
    for learner in dict.fromkeys(table["learner"]):
        if learner == MAIN or MAIN not in sound:
            continue
        both = sound[[learner, MAIN]].dropna().astype(float).groupby("seed").mean()
        if len(both):
            difference = paired_difference(both[learner].to_numpy(), both[MAIN].to_numpy())
            rows.append(interval_row(str(learner), setting, BESIDE_MAIN, difference))
    return rows


def figure_5_5(runs: Mapping[str, Iterable[Learning]], thesis: Thesis, points: int = 51) -> pd.DataFrame:
    """Success of evaluations during training against control steps: mean and t limits over seeds, and each seed.

    Means begin where every run has been evaluated: a learner without a policy before its first rounds is not at 0.
    """
    rows: list[Row] = []
    for world, world_runs in runs.items():
        for learner, own in _by_learner(world_runs).items():
            first = max(float(run.evaluations["control_steps"].iloc[0]) for run in own)
            last = max(float(run.evaluations["control_steps"].iloc[-1]) for run in own)
            for steps in np.linspace(first, last, points):
                interval = t_interval([_at(run.evaluations, steps) for run in own])
                setting = f"world={world};control_steps={round(steps)}"
                rows.append(interval_row(learner, setting, "success", interval))
            for run in own:
                for one in run.evaluations.to_dict("records"):
                    setting = f"world={world};seed={run.seed};control_steps={round(one['control_steps'])}"
                    rows.append(single_row(learner, setting, "success", one["success"]))
    return thesis.beside(table_of(rows), CURVES)


def figure_5_8(runs: Mapping[str, Iterable[Learning]], thesis: Thesis) -> pd.DataFrame:
    """Counts of each nominal option in a round of decisions: mean and t limits over seeds, and each seed."""
    rows: list[Row] = []
    for world, world_runs in runs.items():
        for learner, own in _by_learner(world_runs).items():
            options = [name for name in own[0].rounds.columns if name.startswith("chosen:from ")]
            for number in range(min(len(run.rounds) for run in own)):
                for option in options:
                    counts = {run.seed: float(run.rounds[option].iloc[number]) for run in own}
                    interval = t_interval(list(counts.values()))
                    metric = option.removeprefix("chosen:from ")
                    setting = f"world={world};round={number}"
                    rows.append(interval_row(learner, setting, metric, interval))
                    for seed, count in counts.items():
                        rows.append(single_row(learner, f"{setting};seed={seed}", metric, count))
    return thesis.beside(table_of(rows), OPTIONS)


def steps_to_thesis(table: pd.DataFrame, runs: Mapping[str, Iterable[Learning]], thesis: Thesis) -> pd.DataFrame:
    """Control steps at which a run first does as well as the thesis's learner, and their ratio to the thesis's budget.

    A learner that the thesis does not have is held against the thesis's RC.

    Overall success during training = nominal + (1 − nominal) · success of an evaluation, nominal being that of
    `table_5_1`; for a learner of the whole task, that of the evaluation. Since one of many evaluations is good by luck,
    it must be reached in two in a row, of which the first counts. Runs that never get there count with all their steps,
    and `reached` says how many do. A learner whose success in the thesis the nominal skills here have without it, or
    that the table lacks, has no rows.
    """
    rows: list[Row] = []
    for world, world_runs in runs.items():
        setting = f"world={world}"
        here = table[table["setting"] == setting]
        methods, recovering = set(here["method"]), set(here[here["metric"] == "recovery"]["method"])
        base = here[here["method"] == "nominal"]
        for learner, own in _by_learner(world_runs).items():
            own_success = thesis.value(TABLE, learner, setting, "success")
            success = thesis.value(TABLE, "rc", setting, "success") if own_success is None else own_success
            if success is None or not len(base) or learner not in methods:
                continue
            before = float(base["mean"].iloc[0]) if learner in recovering else 0.0
            target = (success - before) / max(1.0 - before, 1e-9)
            if target <= 0.0:
                continue
            steps = [_first(run.evaluations, target) for run in own]
            share = float(np.mean([step is not None for step in steps]))
            control_steps = [
                float(run.evaluations["control_steps"].iloc[-1]) if step is None else step
                for run, step in zip(own, steps, strict=True)
            ]
            for name, values in (
                ("control_steps", np.array(control_steps)),
                ("ratio", np.array(control_steps) / BUDGET),
            ):
                interval = t_interval(values)
                low = np.maximum(interval.low, 0.0)  # t limits of few and very unequal runs reach below
                rows.append(interval_row(learner, setting, name, replace(interval, low=low)))
            rows.append(single_row(learner, setting, "reached", share, len(own)))
    return thesis.beside(table_of(rows), "steps_to_thesis")


def _first(evaluations: pd.DataFrame, success: float) -> float | None:
    good = evaluations["success"].to_numpy() >= success
    twice = np.flatnonzero(good[:-1] & good[1:])
    return float(evaluations["control_steps"].iloc[twice[0]]) if len(twice) else None


def _at(evaluations: pd.DataFrame, steps: float) -> float:
    """Success of the last evaluation so far."""
    rows = evaluations[evaluations["control_steps"] <= steps]
    return float(rows["success"].iloc[-1])


def _by_learner(runs: Iterable[Learning]) -> dict[str, list[Learning]]:
    by_learner: dict[str, list[Learning]] = {}
    for run in sorted(runs, key=lambda one: one.seed):
        by_learner.setdefault(run.learner, []).append(run)
    return by_learner


def _of(method: str, setting: str, metric: str, rate: Mapping[str, float]) -> Row:
    return method, setting, metric, rate["mean"], rate["low"], rate["high"], int(rate["n"])

"""Accuracy and calibration of the learnt preconditions, and accuracy against the number of samples (section 4.4).

All scores are those of held-out samples. `label` says whether the next precondition holds where the skill ends, as in
training; `solved` whether the chain from there on reaches the goal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from p2l.artifacts import finite, save_arrays, save_json
from p2l.evaluation.sheets import save_sheets
from p2l.evaluation.statistics import wilson_interval
from p2l.evaluation.style import plain
from p2l.preconditions.backwards import Chaining, ChainingOptions, Samples, fit_one
from p2l.preconditions.classifier import PreconditionClassifier
from p2l.preconditions.record import save_preconditions
from p2l.records import BoolArray, IntArray
from p2l.seeding import generator
from p2l.transfer.calibration import reliability

CLOSE = 0.75  # share of the training samples; a count above it is too close to all of them for a point of its own


def precondition_report(
    out: Path, item: str, chaining: Chaining, options: ChainingOptions, counts: Sequence[int], seed: int
) -> None:
    """Write preconditions.npz, samples.npz, scores.csv, calibration.csv, accuracy.csv, a figure and summary.json.

    Args:
        out: folder.
        item: the world's name, for the title.
        chaining: what Algorithm 2 made.
        options: it was made with.
        counts: see `sample_curve`.
        seed: of the curve.
    """
    tables = {
        "scores": score_table(chaining),
        "calibration": calibration_table(chaining),
        "accuracy": sample_curve(chaining, options, counts, seed),
    }
    facts = summary(chaining, tables["scores"])
    title = f"{item}: preconditions from {facts['samples']} samples"
    figure = precondition_figure(tables["scores"], tables["calibration"], tables["accuracy"], title)
    save_preconditions(out / "preconditions.npz", chaining.preconditions)
    save_arrays(out / "samples.npz", chaining.sample_arrays(), schema="precondition_samples", version=1)
    save_sheets(out, tables, {"preconditions": figure})
    save_json(out / "summary.json", facts, schema="preconditions_summary", version=1)


def score_table(chaining: Chaining) -> pd.DataFrame:
    """One row per skill and score: `skill, metric, value, low, high, n`; Wilson intervals of 95 %."""
    rows = []
    record = chaining.preconditions
    for name, skill, samples in zip(record.names, record.skills, chaining.samples, strict=True):
        test = samples.held_out
        inside = skill.holds(samples.states[test], record.threshold)
        label, solved = samples.labels[test], samples.solved[test]
        metrics: dict[str, tuple[BoolArray, BoolArray]] = {
            "accuracy": (inside == label, np.ones_like(inside)),
            "precision": (label, inside),
            "recall": (inside, label),
            "solved_where_it_holds": (solved, inside),
            "accuracy_moved": (inside == label, samples.moved[test]),
        }
        for metric, (hit, among) in metrics.items():
            count, hits = int(among.sum()), int((hit & among).sum())
            low, high = wilson_interval(hits, max(count, 1)) if count else (np.nan, np.nan)
            rows.append((name, metric, hits / count if count else np.nan, float(low), float(high), count))
    return pd.DataFrame(rows, columns=["skill", "metric", "value", "low", "high", "n"])


def summary(chaining: Chaining, scores: pd.DataFrame) -> dict[str, Any]:
    """Counts of trajectories and samples, nominal success, and held-out scores; `scores` is that of `score_table`."""
    keys = scores["skill"] + "/" + scores["metric"]
    values = zip(keys.tolist(), scores["value"].tolist(), strict=True)
    return {
        "trajectories": chaining.trajectories,
        "successful": chaining.successful,
        "samples": sum(len(samples.labels) for samples in chaining.samples),
        "nominal": dict(zip(chaining.preconditions.names, chaining.preconditions.nominal.tolist(), strict=True)),
        "scores": {key: finite(value) for key, value in values},
    }


def calibration_table(chaining: Chaining, bins: int = 8) -> pd.DataFrame:
    """Reliability by skill: `skill, mean_p, rate, low, high, n` of each bin that holds samples."""
    tables = []
    record = chaining.preconditions
    for name, skill, samples in zip(record.names, record.skills, chaining.samples, strict=True):
        p = skill.probability(samples.states[samples.held_out])
        curve = reliability(p, samples.labels[samples.held_out].astype(np.int64), 1, bins)
        mask = curve.pairs > 0
        low, high = wilson_interval(curve.successes[mask], curve.executions[mask])
        columns = {
            "mean_p": curve.mean_p[mask],
            "rate": curve.rate[mask],
            "low": low,
            "high": high,
            "n": curve.pairs[mask],
        }
        tables.append(pd.DataFrame({"skill": name, **columns}))
    return pd.concat(tables, ignore_index=True)


def sample_curve(
    chaining: Chaining, options: ChainingOptions, counts: Sequence[int], seed: int, draws: int = 3
) -> pd.DataFrame:
    """Accuracy against the number of training samples: `skill, samples, draw, accuracy`; the last is all of them.

    Labels are those of all samples, and the good starts stay; only the last step, fitting a skill's classifier, is
    repeated with fewer samples.
    """
    rows = []
    record = chaining.preconditions
    for index, (name, samples, good) in enumerate(zip(record.names, chaining.samples, chaining.good, strict=True)):
        test, train = samples.held_out, np.flatnonzero(~samples.held_out)
        for count in (*(count for count in counts if count <= CLOSE * len(train)), len(train)):
            for draw in range(draws):
                rng = generator(seed, "preconditions", "curve", index, count, draw)
                skill = fit_one(
                    record.skills[index].feature_names, _some(samples, train, count, rng), good, options, rng
                )
                rows.append((name, count, draw, _accuracy(skill, samples, test)))
    return pd.DataFrame(rows, columns=["skill", "samples", "draw", "accuracy"])


def _some(samples: Samples, train: IntArray, count: int, rng: np.random.Generator) -> Samples:
    selection = rng.permutation(train)[:count]
    return replace(samples, **{name: getattr(samples, name)[selection] for name in Samples.__dataclass_fields__})


def _accuracy(skill: PreconditionClassifier, samples: Samples, test: BoolArray) -> float:
    if not test.any():
        return float("nan")
    return float((skill.holds(samples.states[test]) == samples.labels[test]).mean())


def precondition_figure(scores: pd.DataFrame, calibration: pd.DataFrame, curve: pd.DataFrame, title: str) -> Figure:
    """Above the calibration of each skill, below its accuracy against the number of samples."""
    names = list(dict.fromkeys(scores["skill"]))
    figure = Figure(figsize=(3.4 * len(names), 6.2), layout="constrained")
    axes = figure.subplots(2, len(names), squeeze=False, sharey="row")
    for column, name in enumerate(names):
        above, below = axes[0, column], axes[1, column]
        mine = calibration[calibration["skill"] == name]
        above.plot([0, 1], [0, 1], color="0.75", lw=1, zorder=0)
        spread = np.vstack([mine["rate"] - mine["low"], mine["high"] - mine["rate"]]).clip(min=0.0)
        above.errorbar(mine["mean_p"], mine["rate"], yerr=spread, fmt="o-", color="#0072B2", capsize=2)
        values = scores[scores["skill"] == name].set_index("metric")["value"]
        label = ", ".join(f"{metric} {values[metric]:.2f}" for metric in ("accuracy", "precision", "recall"))
        above.set(xlim=(-0.03, 1.03), ylim=(-0.03, 1.03), xlabel="predicted probability")
        above.set_title(f"{name.replace('_', ' ')}\n{label}", fontsize=9)
        accuracy = curve[curve["skill"] == name].groupby("samples")["accuracy"]
        below.plot(accuracy.mean().index, accuracy.mean(), "o-", color="#0072B2")
        below.fill_between(accuracy.min().index, accuracy.min(), accuracy.max(), color="#0072B2", alpha=0.2, lw=0)
        below.set(xscale="log", xlabel="training samples (band: 3 draws)")
        below.set_xticks(accuracy.mean().index, [str(count) for count in accuracy.mean().index], fontsize=8)
        below.minorticks_off()
        for each in (above, below):
            plain(each)
    axes[0, 0].set_ylabel("success rate (95 % Wilson)")
    axes[1, 0].set_ylabel("share of held-out samples\nclassified rightly")
    figure.suptitle(title)
    return figure

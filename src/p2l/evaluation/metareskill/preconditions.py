"""How good are the learnt preconditions, and what would fewer samples have given (thesis, section 4.4)?

Everything is judged on held-out samples. `label` asks whether the next precondition holds where the skill ends, as it
was trained; `solved` whether the chain from there on really reaches the goal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from p2l.artifacts import finite
from p2l.evaluation.statistics import wilson_interval
from p2l.evaluation.style import plain
from p2l.preconditions.backwards import Chaining, ChainingOptions, Samples, fit_one
from p2l.preconditions.classifier import PreconditionClassifier
from p2l.records import BoolArray, IntArray
from p2l.seeding import generator
from p2l.transfer.calibration import reliability

CLOSE = 0.75  # of all training samples: counts above are not told apart from all


def score_table(found: Chaining) -> pd.DataFrame:
    """One row per skill and score: `skill, metric, value, low, high, n`; Wilson intervals of 95 %."""
    rows = []
    record = found.preconditions
    for name, skill, samples in zip(record.names, record.skills, found.samples, strict=True):
        test = samples.held_out
        inside = skill.holds(samples.states[test], record.threshold)
        label, solved = samples.labels[test], samples.solved[test]
        told: dict[str, tuple[BoolArray, BoolArray]] = {
            "accuracy": (inside == label, np.ones_like(inside)),
            "precision": (label, inside),
            "recall": (inside, label),
            "solved_where_it_holds": (solved, inside),
            "accuracy_moved": (inside == label, samples.moved[test]),
        }
        for metric, (hit, among) in told.items():
            count, hits = int(among.sum()), int((hit & among).sum())
            low, high = wilson_interval(hits, max(count, 1)) if count else (np.nan, np.nan)
            rows.append((name, metric, hits / count if count else np.nan, float(low), float(high), count))
    return pd.DataFrame(rows, columns=["skill", "metric", "value", "low", "high", "n"])


def summary(found: Chaining, scores: pd.DataFrame) -> dict[str, Any]:
    """Plain facts; `scores` is that of `score_table`."""
    keys = scores["skill"] + "/" + scores["metric"]
    named = zip(keys.tolist(), scores["value"].tolist(), strict=True)
    return {
        "trajectories": found.trajectories,
        "successful": found.successful,
        "samples": sum(len(samples.labels) for samples in found.samples),
        "nominal": dict(zip(found.preconditions.names, found.preconditions.nominal.tolist(), strict=True)),
        "scores": {key: finite(value) for key, value in named},
    }


def calibration_table(found: Chaining, bins: int = 8) -> pd.DataFrame:
    """Reliability by skill: `skill, mean_p, rate, low, high, n` of each bin that holds samples."""
    tables = []
    record = found.preconditions
    for name, skill, samples in zip(record.names, record.skills, found.samples, strict=True):
        p = skill.probability(samples.states[samples.held_out])
        curve = reliability(p, samples.labels[samples.held_out].astype(np.int64), 1, bins)
        kept = curve.pairs > 0
        low, high = wilson_interval(curve.successes[kept], curve.executions[kept])
        columns = {
            "mean_p": curve.mean_p[kept],
            "rate": curve.rate[kept],
            "low": low,
            "high": high,
            "n": curve.pairs[kept],
        }
        tables.append(pd.DataFrame({"skill": name, **columns}))
    return pd.concat(tables, ignore_index=True)


def sample_curve(
    found: Chaining, options: ChainingOptions, counts: Sequence[int], seed: int, draws: int = 3
) -> pd.DataFrame:
    """Accuracy against the number of training samples: `skill, samples, draw, accuracy`; the last is all of them.

    Labels are those of all samples, and the good starts stay; only the last step, fitting a skill's classifier, is
    repeated with fewer samples.
    """
    rows = []
    record = found.preconditions
    for index, (name, samples, good) in enumerate(zip(record.names, found.samples, found.good, strict=True)):
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
    kept = rng.permutation(train)[:count]
    return replace(samples, **{name: getattr(samples, name)[kept] for name in Samples.__dataclass_fields__})


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
        said = scores[scores["skill"] == name].set_index("metric")["value"]
        told = ", ".join(f"{metric} {said[metric]:.2f}" for metric in ("accuracy", "precision", "recall"))
        above.set(xlim=(-0.03, 1.03), ylim=(-0.03, 1.03), xlabel="predicted probability")
        above.set_title(f"{name.replace('_', ' ')}\n{told}", fontsize=9)
        grown = curve[curve["skill"] == name].groupby("samples")["accuracy"]
        below.plot(grown.mean().index, grown.mean(), "o-", color="#0072B2")
        below.fill_between(grown.min().index, grown.min(), grown.max(), color="#0072B2", alpha=0.2, lw=0)
        below.set(xscale="log", xlabel="training samples (band: 3 draws)")
        below.set_xticks(grown.mean().index, [str(count) for count in grown.mean().index], fontsize=8)
        below.minorticks_off()
        for each in (above, below):
            plain(each)
    axes[0, 0].set_ylabel("success rate (95 % Wilson)")
    axes[1, 0].set_ylabel("share of held-out samples\nclassified rightly")
    figure.suptitle(title)
    return figure

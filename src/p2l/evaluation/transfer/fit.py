"""Predictions of the precondition predictor and its baselines on held-out tasks; the report of `fit_transfer`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from p2l.artifacts import atomic, save_json
from p2l.evaluation.transfer.reliability import reliability_diagram
from p2l.evaluation.transfer.scores import Predictions, calibration_table, records, score_table
from p2l.records import TransferData
from p2l.seeding import generator
from p2l.transfer import baselines
from p2l.transfer.calibration import Platt
from p2l.transfer.fitting import Fit, TaskSplit
from p2l.transfer.model import TransferModel


def held_out_predictions(data: TransferData, model: TransferModel, split: TaskSplit) -> list[Predictions]:
    """Predictions of the model, without and with its correction, and of the baselines on held-out pairs."""
    raw = replace(model, platt=Platt())
    columns = np.flatnonzero(split.held_out)
    held_out = split.held_out[data.train_task]
    predictions = []
    for pairs, skills in (("new_test", np.flatnonzero(~held_out)), ("both_new", np.flatnonzero(held_out))):
        if skills.size == 0:
            continue
        tasks = data.train_task[skills]
        train, test = data.features[tasks], data.features[columns]
        probabilities = {
            "model": model.predict(train, test),
            "uncorrected": raw.predict(train, test),
            "nearest_neighbour": baselines.nearest_neighbour(data, split, model, train, test),
            "constant": baselines.constant(data, split, train, test),
        }
        counts = data.successes[np.ix_(skills, columns)].ravel()
        grid = [axis.ravel() for axis in np.meshgrid(tasks, columns, indexing="ij")]
        for name, p in probabilities.items():
            predictions.append(Predictions(name, pairs, p.ravel(), counts, data.draws, *grid))
    return predictions


def fit_report(
    out: Path, domain: str, data: TransferData, fitting: Fit, losses: Mapping[float, float], split: TaskSplit, seed: int
) -> None:
    """Write metrics.json, calibration.csv and calibration.png.

    Args:
        out: folder.
        domain: name, for the title and the seed of intervals.
        data: what was collected.
        fitting: the fit that was kept.
        losses: by weight decay, see `fit_best`.
        split: of the tasks.
        seed: of the intervals.
    """
    predictions = held_out_predictions(data, fitting.model, split)
    scores = score_table(predictions, generator(seed, "fit_transfer", domain, "intervals"))
    table = calibration_table(predictions)
    with atomic(out / "calibration.csv") as temporary:
        table.to_csv(temporary, index=False)
    reliability_diagram(table, ("model", "nearest_neighbour"), domain, out / "calibration.png")
    facts: dict[str, Any] = {
        "tasks_fitted": int((~split.held_out).sum()),
        "tasks_held_out": int(split.held_out.sum()),
        "weight_decay": min(losses, key=losses.__getitem__),
        "loss_by_weight_decay": {str(decay): loss for decay, loss in losses.items()},
        "platt": {"slope": fitting.model.platt.slope, "shift": fitting.model.platt.shift},
        "best_epoch": fitting.best_epoch.tolist(),
        "scores": records(scores),
    }
    save_json(out / "metrics.json", facts, schema="fit_transfer_metrics", version=1)

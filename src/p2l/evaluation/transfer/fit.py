"""Predictions of the precondition predictor and its baselines on held-out tasks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from p2l.evaluation.transfer.scores import Predictions
from p2l.records import TransferData
from p2l.transfer import baselines
from p2l.transfer.calibration import Platt
from p2l.transfer.fitting import TaskSplit
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

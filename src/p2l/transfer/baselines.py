"""What the predictor has to beat: a constant, and the nearest pairs.

Each is fitted to the pairs whose two tasks were not held out, and predicts [K, M] like `TransferModel`.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from p2l.records import Array, IntArray, TransferData
from p2l.transfer.fitting import TaskSplit
from p2l.transfer.model import TransferModel

_RIDGE = 0.5  # Jeffreys' prior: no certainty out of a handful of executions


def constant(data: TransferData, split: TaskSplit, train: Array, test: Array) -> Array:
    """The mean success rate of the fitted pairs, for every pair."""
    rows, columns = _fit_pairs(data, split)
    return np.full((len(train), len(test)), data.rate[np.ix_(rows, columns)].mean())


def nearest_neighbour(
    data: TransferData, split: TaskSplit, model: TransferModel, train: Array, test: Array, neighbours: int = 5
) -> Array:
    """Mean success rate of the nearest fitted pairs, in the encoded and standardised space of pairs.

    The rate has Jeffreys' half success and half failure added, else its logarithmic loss is infinite.
    """
    rows, columns = _fit_pairs(data, split)
    references = _encode(model, data.features[data.train_task[rows]], data.features[columns])
    points = _encode(model, train, test)
    successes = data.successes[np.ix_(rows, columns)].ravel()
    count = min(neighbours, len(references))
    _, index = cKDTree(references).query(points, k=np.arange(1, count + 1))
    rate = (successes[index].sum(axis=1) + _RIDGE) / (count * data.draws + 2 * _RIDGE)
    return np.asarray(rate.reshape(len(train), len(test)))


def _fit_pairs(data: TransferData, split: TaskSplit) -> tuple[IntArray, IntArray]:
    """Rows and columns of the pairs whose two tasks were not held out."""
    inside = ~split.held_out
    return np.flatnonzero(inside[data.train_task]), np.flatnonzero(inside)


def _encode(model: TransferModel, train: Array, test: Array) -> Array:
    """Pairs [K · M, D] as the network sees them."""
    pairs = model.pairs(train, test)
    return pairs.reshape(-1, pairs.shape[2])

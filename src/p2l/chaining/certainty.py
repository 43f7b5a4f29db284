"""From which predicted probability on an outcome is certain enough, by outcomes that were held out."""

from __future__ import annotations

import numpy as np

from p2l.records import Array, BoolArray


def certain_from(probability: Array, success: BoolArray, precision: float, support: int) -> float | None:
    """The lowest threshold at and above which more than `precision` of at least `support` outcomes are successes."""
    order = np.argsort(-probability, kind="stable")
    right = np.cumsum(success[order]) / np.arange(1, len(order) + 1)
    last_of_value = np.append(np.diff(probability[order]) < 0.0, True)
    good = np.flatnonzero((right > precision) & last_of_value & (np.arange(len(order)) >= support - 1))
    return None if not len(good) else float(probability[order[good[-1]]])

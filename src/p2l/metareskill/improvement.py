"""How much could a recovery improve in another round? An upper confidence limit (thesis, section 4.3.4, Algorithm 3).

The limit of the mean of the last W forward differences of a success rate, under the assumption that they are normal:
mean + t · s / √n, with s their standard deviation and t the quantile of a two-sided interval of confidence α, that is
the (1 + α)/2 quantile of Student's t with n − 1 degrees of freedom.

Reading of the thesis:
1. Algorithm 3 keeps a queue of w success rates, the text "the w most recent forward differences"; figure 4.4 predicts
   round 5 from the improvement in rounds 2 to 4 with w = 3. Hence w differences, of w + 1 rates.
2. The first difference counts from the success rate before any training, which is 0 (section 4.3.3): with the K = 2
   initial rounds of section 4.4.2 there would otherwise be a single difference and no spread.
3. With fewer than two differences the limit is infinite, and the success rate may become 1.

A flaw of the thesis's limit: two unsolved first queries are two differences of 0, their spread is 0, the limit equals
the success rate, and that recovery is not trained again as long as another one promises anything. `doubt` is a cure
that is not the thesis's: where none of n ≥ 2 trainings has raised a success rate, the limit is that of the chance that
the next one does, 1 − (1 − α)^(1/n), which no failures in n trials leave open (0.78 after two, 0.26 after ten).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p2l.metareskill.history import History
from p2l.records import Array, IntArray


@dataclass(frozen=True)
class Improvement:
    """The model of improvement of every recovery, [I, M] each.

    Attributes:
        mean: rate of improvement per round; 0 without data.
        upper: its upper confidence limit; infinite with fewer than two differences.
        q_upper: best success rate plus `upper`, within [0, 1].
    """

    mean: Array
    upper: Array
    q_upper: Array


def quantile(confidence: float, count: IntArray) -> Array:
    """Student's t of a two-sided interval of `confidence` for the mean of `count` ≥ 2 values."""
    from scipy.special import stdtrit  # takes as long to load as all else that a stage without it needs

    return np.asarray(stdtrit(count - 1, (1.0 + confidence) / 2.0))


def improvement(history: History, *, window: int, confidence: float, doubt: bool = False) -> Improvement:
    """Limits of all recoveries from their last `window` forward differences; without `doubt` those of the thesis."""
    differences = history.last_differences(window)
    finite = np.isfinite(differences)
    count = finite.sum(axis=-1)
    values = np.where(finite, differences, 0.0)
    mean = values.sum(axis=-1) / np.maximum(count, 1)
    squares = (np.where(finite, values - mean[..., None], 0.0) ** 2).sum(axis=-1)
    enough = np.maximum(count, 2)
    error = np.sqrt(squares / (enough - 1) / enough)
    upper = np.where(count >= 2, mean + quantile(confidence, enough) * error, np.inf)
    if doubt:
        unraised = (history.counts >= 2) & (history.best == history.initial)
        chance = 1.0 - (1.0 - confidence) ** (1.0 / np.maximum(history.counts, 1))
        upper = np.where(unraised, chance, upper)
    return Improvement(mean, upper, np.clip(history.best + upper, 0.0, 1.0))

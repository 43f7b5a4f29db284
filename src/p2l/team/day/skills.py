"""What outcomes say of a lesson that was given: a posterior of its success on every task of the day.

The thesis plans once, with predicted probabilities. Its predictions of one lesson are wrong together: a demonstration
that taught less than was thought is worse on all tasks. Deviations, numbered:

1. A lesson's success on task i is Beta distributed with mean m_i(θ) and the strength of n_i attempts, given a shift θ
   of the log-odds that all tasks of the lesson share, θ ~ N(0, spread²): m_i(θ) = sigmoid(a_i + κ_i θ). Independent
   betas (spread = 0) would learn nothing from one task for another, and a day has most tasks once; a shift alone
   (n_i = ∞) could never learn that one task is an exception.
2. a_i is such that the mean over θ is the prediction ρ_i: without outcomes nothing changes. A prediction of 0 or 1
   stays what it is, whatever happens to other tasks.
3. n_i = prior_n + the attempts behind ρ_i in the transfer table, and κ_i = prior_n / n_i: what was measured often is
   moved less by its neighbours.
4. Pre-trained skills have the same betas and no shift: they are one number per task, of as many skills as there may be.

θ is on a grid, so that the posterior is a finite sum; it depends on the numbers of successes and failures alone, and so
not on their order.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy import special

from p2l.errors import ConfigError
from p2l.records import Array, freeze

_NODES, _REACH = 61, 5.0  # of the grid: nodes, and standard deviations to each side
_SURE = 1e-12  # a prediction of 0 or 1 tells of the shift what one that is this far from it would
_STEPS, _CLOSE, _LEAST = 60, 1e-12, 1e-15  # of Newton's method, which ends sooner; its error; no probability is less


@dataclass(frozen=True)
class SkillPrior:
    """How fast outcomes change what is believed.

    The defaults are near those that explain best how predictions of `insertion` fail (walls, other seeds than those
    that plans are judged by; see `scripts/replanning.py`).

    Attributes:
        prior_n: attempts that a prediction counts for.
        spread: standard deviation of the shift that the log-odds of a lesson's successes share.

    Raises:
        ConfigError: a number out of range.
    """

    prior_n: float = 1.0
    spread: float = 0.5

    def __post_init__(self) -> None:
        if not 0.0 < self.prior_n <= 1e6:
            raise ConfigError(f"prior_n: {self.prior_n} given; expected a number above 0, at most 1e6")
        if not 0.0 <= self.spread <= 10.0:
            raise ConfigError(f"spread: {self.spread} given; expected a number from 0 to 10")


def expected_skill(
    predicted: Array, trials: Array, successes: Array, failures: Array, setting: SkillPrior, *, shared: bool = True
) -> Array:
    """[n] posterior mean of one skill's success.

    Args:
        predicted: [n] probabilities before the day.
        trials: [n] attempts behind them.
        successes: [n] counts of the day.
        failures: [n] counts of the day.
        setting: strengths.
        shared: whether tasks share a shift; pre-trained skills do not.

    Raises:
        ShapeError: a probability outside [0, 1], a negative count.
    """
    sizes: dict[str, int] = {}
    rho = freeze("predicted", predicted, ("n",), sizes, low=0.0, high=1.0)
    n, won, lost = (
        freeze(name, value, ("n",), sizes, low=0.0)
        for name, value in (("trials", trials), ("successes", successes), ("failures", failures))
    )
    if not (won.any() or lost.any()):
        return rho
    n = n + setting.prior_n
    if not shared or setting.spread == 0.0:
        return np.asarray((n * rho + won) / (n + won + lost))
    mean, log_posterior = _given_shift(rho, n, won, lost, setting)
    posterior = np.exp(log_posterior - log_posterior.max())
    expected = mean @ (posterior / posterior.sum())
    is_sure = (rho <= _SURE) | (rho >= 1.0 - _SURE)
    expected[is_sure] = rho[is_sure]
    return np.clip((n * expected + won) / (n + won + lost), 0.0, 1.0)


def log_likelihood(predicted: Array, successes: Array, failures: Array, setting: SkillPrior) -> float:
    """How well a setting explains outcomes [n] of one lesson whose predictions [n] no attempts are behind."""
    _, joint = _given_shift(predicted, np.full(len(predicted), setting.prior_n), successes, failures, setting)
    return float(special.logsumexp(joint))


def _given_shift(rho: Array, n: Array, won: Array, lost: Array, setting: SkillPrior) -> tuple[Array, Array]:
    """Mean success of each task after each shift, [n, K], and [K] log probability of the shift and the outcomes."""
    shift, weight = _grid(setting.spread)
    mean = _shifted(rho, setting.prior_n / n, shift, weight)
    tried = np.flatnonzero((won > 0.0) | (lost > 0.0))
    a, b = n[tried, None] * mean[tried], n[tried, None] * (1.0 - mean[tried])
    s, f = won[tried, None], lost[tried, None]
    return mean, np.log(weight) + (special.betaln(a + s, b + f) - special.betaln(a, b)).sum(axis=0)


@cache
def _grid(spread: float) -> tuple[Array, Array]:
    """Shifts [K] and their weights [K] before any outcome."""
    nodes = np.linspace(-_REACH, _REACH, _NODES)
    weights = np.exp(-0.5 * nodes**2)
    return spread * nodes, weights / weights.sum()


def _shifted(rho: Array, share: Array, shift: Array, weight: Array) -> Array:
    """[n, K] success after each shift, whose mean over the weights is `rho`."""
    target = special.logit(np.clip(rho, _SURE, 1.0 - _SURE))
    offset = target.copy()
    moved = share[:, None] * shift
    low, high = target - np.abs(moved).max(axis=1), target + np.abs(moved).max(axis=1)
    for _ in range(
        _STEPS
    ):  # Newton's method on the logit of the mean, which is nearly linear, within bounds that close
        p = special.expit(offset[:, None] + moved)
        mean = np.clip(p @ weight, _LEAST, 1.0 - _LEAST)
        error = target - special.logit(mean)
        low, high = np.where(error > 0.0, offset, low), np.where(error < 0.0, offset, high)
        slope = (p * (1.0 - p)) @ weight / (mean * (1.0 - mean))
        step = offset + error / np.maximum(slope, _LEAST)
        offset = np.where((step >= low) & (step <= high), step, 0.5 * (low + high))
        if np.abs(error).max() < _CLOSE:
            break
    return np.clip(special.expit(offset[:, None] + moved), _SURE, 1.0 - _SURE)  # a beta needs both

"""What is believed of a recovery's learning curve: will a query be solved, where does it end, how fast is it there.

A hypothesis says that each query is solved with probability p, and that after n solved ones the success rate is
q₀ + (c − q₀)(1 − ρⁿ): it starts at q₀ and saturates at its ceiling c. A grid of (p, c, ρ) carries the posterior of
every recovery, so that sums over it are exact; whether queries were solved counts, and not only what was measured.

1. Hypotheses are weighed by what other recoveries showed: those of the same mode, those to the same target, and all
   others (`Sharing`). A mode that is easy to leave, or a target that cannot be reached, is known after few queries.
2. A measurement counts as a number of trials, at most `trust`: the same held-out failures are measured again and
   again, and no curve is exactly of this form.

Axis letters: G hypotheses, I modes, M targets, T rounds, R = I · M recoveries.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from p2l.metareskill.history import History
from p2l.records import Array, BoolArray

SOLVED = (0.02, 0.15, 0.35, 0.6, 0.85, 0.97)
CEILING = (0.02, 0.15, 0.3, 0.45, 0.6, 0.75, 0.88, 0.98)
PACE = (0.3, 0.6, 0.8, 0.9, 0.95)
UNMEASURED = 50  # trials that a success rate counts as which comes without their number
LEAST = 0.01  # of a success rate as a hypothesis, so that none excludes what was measured


@dataclass(frozen=True)
class Sharing:
    """How much a recovery's own prior is worth, and each other one that was trained, by what they have in common."""

    own: float = 1.0
    mode: float = 0.2
    target: float = 0.2
    rest: float = 0.05


@dataclass(frozen=True)
class CurveBelief:
    """The posterior of all recoveries.

    Attributes:
        solved: [G] p, that a query is solved.
        ceiling: [G] c.
        pace: [G] ρ, the share of the rest that a solved query leaves.
        weight: [G, I, M] probability of each hypothesis.
        start: [I, M] q₀.
        count: [I, M] queries that were solved.
    """

    solved: Array
    ceiling: Array
    pace: Array
    weight: Array
    start: Array
    count: Array

    def rates(self, more: int = 0) -> Array:
        """[G, I, M] success rate of each hypothesis after so many solved queries more."""
        return _rates(self.ceiling, self.pace, self.start, self.count + more)

    @property
    def mean(self) -> Array:
        """[I, M] expected success rate at present."""
        return np.asarray((self.weight * self.rates()).sum(axis=0))


def belief(history: History, sharing: Sharing | None = None, trust: float = 10.0) -> CurveBelief:
    """The posterior after all rounds of a history.

    Args:
        history: what was trained, and what came of it.
        sharing: of the recoveries among each other.
        trust: most trials that a measurement counts as.
    """
    solved, ceiling, pace = np.array(list(product(SOLVED, CEILING, PACE))).T
    shape = history.initial.shape
    likelihood, count = _likelihood(history, solved, ceiling, pace, trust)
    weight = _shared(likelihood, history.counts.ravel() > 0, shape, sharing or Sharing())
    return CurveBelief(solved, ceiling, pace, weight.reshape(-1, *shape), history.initial, count.reshape(shape))


def _rates(ceiling: Array, pace: Array, start: Array, count: Array) -> Array:
    rise = np.maximum(ceiling[:, None, None] - start, 0.0)
    return np.asarray(start + rise * (1.0 - pace[:, None, None] ** count))


def _likelihood(history: History, solved: Array, ceiling: Array, pace: Array, trust: float) -> tuple[Array, Array]:
    """[G, R] log-likelihood of all rounds, up to a constant, and [R] solved queries."""
    pairs, rounds = history.pairs, history.rounds
    well = np.array([each.solved for each in rounds], dtype=np.float64)
    recoveries = history.initial.size
    total = np.zeros((len(solved), recoveries))
    count: Array = np.zeros(recoveries)
    if len(rounds):
        count = np.bincount(pairs, well, minlength=recoveries).astype(np.float64)
    unsolved = history.counts.ravel() - count
    total += np.log(solved)[:, None] * count + np.log1p(-solved)[:, None] * unsolved
    if not count.any():
        return total, count
    order = np.argsort(pairs, kind="stable")
    before = np.cumsum(well[order]) - well[order]  # solved ones of all recoveries so far
    starts = np.searchsorted(pairs[order], pairs[order])
    number = np.zeros(len(rounds))
    number[order] = before - before[starts] + well[order]  # of its own recovery, itself included
    measured = np.flatnonzero(well > 0.0)
    q = np.array([each.q for each in rounds])[measured]
    trials = np.array([each.trials or UNMEASURED for each in rounds], dtype=np.float64)[measured]
    start = history.initial.ravel()[pairs[measured]]
    rate = _rates(ceiling, pace, start[None], number[measured][None])[:, 0]  # [G, measured]
    rate = np.clip(rate, LEAST, 1.0 - LEAST)
    each = np.minimum(trials, trust) * (q * np.log(rate) + (1.0 - q) * np.log1p(-rate))
    np.add.at(total.T, pairs[measured], each.T)
    return total, count


def _shared(likelihood: Array, trained: BoolArray, shape: tuple[int, ...], sharing: Sharing) -> Array:
    """[G, R] posterior, each recovery's prior being the mean of a flat one and of what the others showed."""
    hypotheses, recoveries = likelihood.shape
    alone = np.exp(likelihood - likelihood.max(axis=0))
    shown = alone / alone.sum(axis=0)
    mode, target = np.divmod(np.arange(recoveries), shape[1])
    tells = np.full((recoveries, recoveries), sharing.rest)
    tells[mode[:, None] == mode] = sharing.mode
    tells[target[:, None] == target] = sharing.target
    np.fill_diagonal(tells, 0.0)
    tells *= trained[:, None]
    prior = sharing.own / hypotheses + shown @ tells
    posterior = prior * alone
    return np.asarray(posterior / posterior.sum(axis=0))

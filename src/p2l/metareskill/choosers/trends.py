"""Choosers of others that follow the trend of each learning curve, for comparison; both are situated in our graph.

- `extrapolation`: estimate a recovery's competence, extrapolate it by one query, situate it in the graph (Kumar et al.,
  2024, Practice Makes Perfect): the value of failures at the success rate that is expected after one query more, each
  recovery by itself. Their competence model is a saturating curve with a prior, as `curves` has it without sharing.
- `rising`: optimism about rewards that rise with every pull (Mussi et al., 2024, Best Arm Identification for Stochastic
  Rising Bandits; Metelli et al., 2022): the last measurements, continued along their slope over a window, and a bonus
  that shrinks with the window. Their arms are compared by their reward; ours by the value of failures at it.

Axis letters: I modes, M targets.
"""

from __future__ import annotations

import math

import numpy as np

from p2l.metareskill.choosers.contract import Choice, Rule, best_of, check_number
from p2l.metareskill.choosers.curves import Sharing, belief
from p2l.metareskill.graph import SkillGraph
from p2l.metareskill.history import History
from p2l.metareskill.value_iteration import TIE, predicted_value, value_of_failures
from p2l.records import Array

ALONE = Sharing(mode=0.0, target=0.0, rest=0.0)


def extrapolation(trust: float = 10.0) -> Rule:
    """The highest value of failures at the success rate that is expected after one query more.

    Args:
        trust: most trials that a measured success rate counts as, see `curves.belief`.

    Raises:
        ConfigError: a trust of 0 or less.
    """
    check_number("extrapolation: trust", trust, low=0.0, strict=True)

    def rule(graph: SkillGraph, history: History, rng: np.random.Generator) -> Choice:
        beliefs = belief(history, ALONE, trust)
        solved = beliefs.solved[:, None, None]
        expected = (beliefs.weight * (solved * beliefs.rates(1) + (1.0 - solved) * beliefs.rates())).sum(axis=0)
        now = graph.with_q(np.clip(beliefs.mean, 0.0, 1.0))
        rise = predicted_value(now, np.clip(expected, 0.0, 1.0)) - value_of_failures(now)
        return best_of(rise, history, rng, "highest value at the extrapolated rate", tie=0.0)

    return rule


def rising(window: float = 0.25, exploration: float = 0.01, ahead: int = 5) -> Rule:
    """The highest value of failures at an optimistic continuation of each recovery's measurements.

    Args:
        window: share ε of a recovery's rounds that its slope is taken over.
        exploration: a, of the bonus √(a / h³) for each round ahead.
        ahead: rounds by which a curve is continued; theirs is what is left of the budget, which no chooser knows.

    Raises:
        ConfigError: a setting out of range.
    """
    check_number("rising: window", window, low=0.0, high=0.5, strict=True)
    check_number("rising: exploration", exploration, low=0.0)
    check_number("rising: ahead", ahead, low=1, whole=True)

    def rule(graph: SkillGraph, history: History, rng: np.random.Generator) -> Choice:
        hoped = _hoped(history, window, exploration, ahead)
        return best_of(predicted_value(graph, hoped), history, rng, "highest value at an optimistic trend", TIE)

    return rule


def _hoped(history: History, window: float, exploration: float, ahead: int) -> Array:
    """[I, M] optimistic success rates; 1 where a recovery was trained less than twice."""
    rates: dict[int, list[float]] = {}
    for pair, each in zip(history.pairs.tolist(), history.rounds, strict=True):
        rates.setdefault(pair, [float(history.initial.ravel()[pair])]).append(each.q_after)
    hoped = np.ones(history.initial.size)
    for pair, curve in rates.items():
        pulls = len(curve) - 1
        if pulls < 2:
            continue
        h = max(1, math.floor(window * pulls))
        late = np.arange(pulls - h + 1, pulls + 1)
        values = np.array(curve)
        continued = values[late] + (pulls + ahead - late) * (values[late] - values[late - h]) / h
        hoped[pair] = continued.mean() + ahead * math.sqrt(exploration / h**3)
    return np.clip(hoped, history.best.ravel(), 1.0).reshape(history.initial.shape)

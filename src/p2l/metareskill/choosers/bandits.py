"""Bandits over recoveries, for comparison: they use the reward of each round, but no graph and no trend.

The reward of a round is its rise in the value of failures, as a share of the rise that perfect recoveries would bring.
Rewards then lie in [0, 1] and add up to the objective: a bandit that maximises their sum does what MetaReSkill does.
"""

from __future__ import annotations

import math

import numpy as np

from p2l.metareskill.choosers.contract import Choice, Rule, best_of, check_number
from p2l.metareskill.graph import SkillGraph
from p2l.metareskill.history import History
from p2l.metareskill.value_iteration import value_of_failures
from p2l.records import Array


def ucb1(exploration: float = math.sqrt(2.0)) -> Rule:
    """The highest mean reward plus `exploration` · √(ln t / n) (Auer, Cesa-Bianchi and Fischer, 2002: √2).

    Raises:
        ConfigError: a negative exploration.
    """
    check_number("ucb1: exploration", exploration, low=0.0)

    def rule(graph: SkillGraph, history: History, rng: np.random.Generator) -> Choice:
        pulls = np.maximum(history.counts, 1)
        bonus = exploration * np.sqrt(math.log(max(len(history), 1)) / pulls)
        scores = np.where(history.counts > 0, _rewards(graph, history) / pulls + bonus, np.inf)
        return best_of(scores, history, rng, "highest upper bound of reward", tie=0.0)

    return rule


def thompson(prior: float = 1.0) -> Rule:
    """The highest draw from Beta posteriors of the mean rewards.

    A reward r in [0, 1] counts as r of a success and 1 − r of a failure, so that the history decides the posterior.

    Args:
        prior: both parameters of the Beta prior; 1 is uniform.

    Raises:
        ConfigError: a prior of 0 or less.
    """
    check_number("thompson: prior", prior, low=0.0, strict=True)

    def rule(graph: SkillGraph, history: History, rng: np.random.Generator) -> Choice:
        rewards = _rewards(graph, history)
        draws = rng.beta(prior + rewards, prior + history.counts - rewards)
        return best_of(draws, history, rng, "highest draw of reward", tie=0.0)

    return rule


def _rewards(graph: SkillGraph, history: History) -> Array:
    """[I, M] sum of each recovery's rewards."""
    start = float(value_of_failures(graph, history.initial))
    room = float(value_of_failures(graph, np.ones_like(graph.q))) - start
    rises = np.diff(history.values, prepend=start) / room if room > 0.0 else np.zeros(len(history))
    total = np.bincount(history.pairs, np.clip(rises, 0.0, 1.0), minlength=graph.q.size)
    return np.asarray(total.reshape(graph.q.shape), dtype=np.float64)

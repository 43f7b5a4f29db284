"""The contract of a chooser: a rule that maps the graph, the history and a generator to the recovery to train next.

A chooser is made by a factory of its rule, which checks its settings before any training (`choosers.table`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from p2l.errors import ConfigError
from p2l.metareskill.graph import SkillGraph
from p2l.metareskill.history import History
from p2l.metareskill.value_iteration import TIE, greedy
from p2l.records import Array


@dataclass(frozen=True)
class Choice:
    """The recovery to train next, and why.

    Attributes:
        mode, target: the recovery.
        reason: a few words for the table of rounds.
        q_upper: upper confidence limit of its success rate, NaN if the rule has none.
        predicted: value of failures at that limit, NaN likewise.
    """

    mode: int
    target: int
    reason: str
    q_upper: float = math.nan
    predicted: float = math.nan


Rule = Callable[[SkillGraph, History, np.random.Generator], Choice | None]


@dataclass(frozen=True)
class Chooser:
    """A rule, preceded by some rounds of round-robin.

    Attributes:
        name: as registered.
        rule: decides once every recovery was trained `initial_rounds` times.
        initial_rounds: K of Algorithm 3.
    """

    name: str
    rule: Rule
    initial_rounds: int

    def __call__(self, graph: SkillGraph, history: History, rng: np.random.Generator) -> Choice | None:
        """The next recovery; `graph` holds the best success rates so far. None: no training is worth its cost."""
        if history.counts.min() < self.initial_rounds:
            return least_trained(history, "initial round")
        return self.rule(graph, history, rng)


def least_trained(history: History, reason: str) -> Choice:
    """The recovery that got the fewest rounds, the first of them in the order of modes and targets."""
    return _choice(int(history.counts.argmin()), history, reason)


def best_of(scores: Array, history: History, rng: np.random.Generator, reason: str, tie: float = TIE) -> Choice:
    """The recovery of the highest score [I, M]; ties are broken at random."""
    return _choice(int(greedy(scores.reshape(1, -1), rng, tie)[0]), history, reason)


def _choice(pair: int, history: History, reason: str) -> Choice:
    mode, target = divmod(pair, history.initial.shape[1])
    return Choice(mode, target, reason)


def check_number(
    what: str, value: Any, *, low: float, high: float = math.inf, strict: bool = False, whole: bool = False
) -> None:
    """Refuse a setting that is no number, or not in [low, high] ((low, high) if `strict`), finite in any case.

    Raises:
        ConfigError: names the setting, what was given and what is allowed.
    """
    number = isinstance(value, int if whole else (int, float)) and not isinstance(value, bool)
    if number and math.isfinite(value) and low <= value <= high and not (strict and value in (low, high)):
        return
    brackets = "()" if strict else "[]"
    kind = "whole number" if whole else "number"
    raise ConfigError(f"{what}: {value!r} given; it must be a finite {kind} in {brackets[0]}{low}, {high}{brackets[1]}")

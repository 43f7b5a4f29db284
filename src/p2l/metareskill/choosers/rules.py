"""MetaReSkill (thesis, Algorithm 3) and the rules that count rounds instead of reasoning."""

from __future__ import annotations

import dataclasses

import numpy as np

from p2l.errors import ConfigError
from p2l.metareskill.choosers.contract import Choice, Rule, best_of, check_number, least_trained
from p2l.metareskill.graph import SkillGraph
from p2l.metareskill.history import History
from p2l.metareskill.improvement import improvement
from p2l.metareskill.value_iteration import TIE, predicted_value


def metareskill(window: int = 3, confidence: float = 0.95, tie: float = TIE, doubt: bool = False) -> Rule:
    """Train what promises the highest value of failures in the next round.

    Args:
        window: forward differences behind a rate of improvement, at least 2.
        confidence: of the two-sided interval whose upper end is the promise, in (0, 1).
        tie: predictions this close to the best are broken at random.
        doubt: whether a recovery that no training has raised so far may be raised by the next one all the same
            (`improvement`); without it two unsolved first queries end a recovery, as in Algorithm 3.

    Raises:
        ConfigError: a setting out of range.
    """
    check_number("metareskill: window", window, low=2, whole=True)
    check_number("metareskill: confidence", confidence, low=0.0, high=1.0, strict=True)
    check_number("metareskill: tie", tie, low=0.0)
    if not isinstance(doubt, bool):
        raise ConfigError(f"metareskill: doubt: {doubt!r} given; it must be true or false")

    def rule(graph: SkillGraph, history: History, rng: np.random.Generator) -> Choice:
        q_upper = improvement(history, window=window, confidence=confidence, doubt=doubt).q_upper
        prediction = predicted_value(graph, q_upper)
        choice = best_of(prediction, history, rng, "highest predicted value", tie)
        pair = choice.mode, choice.target
        return dataclasses.replace(choice, q_upper=float(q_upper[pair]), predicted=float(prediction[pair]))

    return rule


def round_robin() -> Rule:
    """Train all recoveries in turn."""
    return lambda _graph, history, _rng: least_trained(history, "its turn")


def weighted_round_robin() -> Rule:
    """Train each mode in proportion to its size, and the targets of a mode in turn."""

    def rule(graph: SkillGraph, history: History, _rng: np.random.Generator) -> Choice:
        due = graph.share * (len(history) + 1) - history.counts.sum(axis=1)
        mode = int(due.argmax())
        return Choice(mode, int(history.counts[mode].argmin()), "mode furthest behind its share")

    return rule

"""The learner that plans: macros are searched on recorded failures, a network learns which one to use where."""

from __future__ import annotations

from p2l.chaining.learner import ChainTask, Learner
from p2l.chaining.mdp import Limits
from p2l.chaining.search_settings import SearchSettings


def learner(
    task: ChainTask, limits: Limits, *, trials: int = 200, portfolio: int = 60, longest: int = 8, updates: int = 2000
) -> Learner:
    """The MDP of RecoveryChaining, searched; for the settings see `SearchSettings`.

    Raises:
        ConfigError: a setting is refused, or no decision is left for a macro's option (`Learner`).
    """
    plan = SearchSettings(trials=trials, portfolio=portfolio, longest=longest, updates=updates)
    return Learner(limits, task.failures, search=plan)

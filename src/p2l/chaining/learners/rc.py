"""RecoveryChaining: primitives and terminal nominal options, rewarded by task success (thesis, section 5.3.2)."""

from __future__ import annotations

from p2l.chaining.learner import ChainTask, Learner
from p2l.chaining.mdp import Limits


def learner(task: ChainTask, limits: Limits) -> Learner:
    """The MDP as it is."""
    return Learner(limits, task.failures)

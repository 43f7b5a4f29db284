"""The learner that docs/chains.md shows how to write."""

import numpy as np

from p2l.chaining.learner import ChainTask, Learner
from p2l.chaining.mdp import Limits, Outcomes
from p2l.records import Array, BoolArray


def learner(task: ChainTask, limits: Limits, *, price_per_m: float = 1.0) -> Learner:
    """RecoveryChaining that prefers short ways."""

    def judge(outcomes: Outcomes) -> tuple[Array, BoolArray]:
        way = task.world.privileged(outcomes.after)["grip_pos_m"] - task.world.privileged(outcomes.before)["grip_pos_m"]
        return outcomes.done - price_per_m * np.linalg.norm(way, axis=1), outcomes.done

    return Learner(limits, task.failures, judge=judge)

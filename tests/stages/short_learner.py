"""The learner that docs/chains.md shows how to write."""

import numpy as np

from p2l.chaining.learner import ChainTask, Learner
from p2l.chaining.mdp import Limits, Played
from p2l.records import Array, BoolArray


def learner(task: ChainTask, limits: Limits, *, price_per_m: float = 1.0) -> Learner:
    """RecoveryChaining that prefers short ways."""

    def judge(played: Played) -> tuple[Array, BoolArray]:
        way = task.world.privileged(played.after)["grip_pos_m"] - task.world.privileged(played.before)["grip_pos_m"]
        return played.done - price_per_m * np.linalg.norm(way, axis=1), played.done

    return Learner(limits, task.failures, judge=judge)

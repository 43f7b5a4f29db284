"""Pretrained preconditions: learn to reach the preconditions of the nominal controllers (thesis, 5.3.3).

Preconditions are classifiers fitted offline to nominal trajectories. With the same primitives and failures, an episode
is rewarded, and ends, where one of them holds. Afterwards the controller that scores best there takes over.

1. Failures at which a precondition already holds are nothing to learn from, and left out of the starts.
2. Where no precondition holds at the bounds of an episode, the best-scoring controller takes over all the same.
"""

from __future__ import annotations

import numpy as np

from p2l.chaining.learner import ChainTask, Learner, share, whole
from p2l.chaining.mdp import Limits, Outcomes
from p2l.chaining.preconditions import fit, visit
from p2l.chaining.states import first_state
from p2l.errors import ConfigError
from p2l.records import Array, BoolArray
from p2l.seeding import generator


def learner(
    task: ChainTask, limits: Limits, *, trajectories: int = 300, every: int = 5, threshold: float = 0.5
) -> Learner:
    """Fit the preconditions offline, then reward reaching them.

    Args:
        task: of the policy.
        limits: bounds of an episode.
        trajectories: nominal ones, to fit the preconditions to.
        every: control steps between their states.
        threshold: probability from which a precondition holds.

    Raises:
        ConfigError: a parameter that makes no sense.
    """
    for name, value in (("trajectories", trajectories), ("every", every)):
        if not whole(value, at_least=1):
            raise ConfigError(f"pp: {name} must be an integer of at least 1, got {value!r}")
    if not share(threshold):
        raise ConfigError(f"pp: threshold must be a number above 0 and below 1, got {threshold!r}")
    starts = task.world.sample(generator(task.seed, "pp", task.world.name, "trajectories"), trajectories)
    states = visit(task.world, task.nominal, starts, every=every)
    rng = generator(task.seed, "pp", task.world.name, "fit")
    preconditions = fit(states, task.nominal, limits.fields, threshold, rng)
    open_ones = ~preconditions.holds(first_state(task.world, task.failures, limits).values)

    def judge(outcomes: Outcomes) -> tuple[Array, BoolArray]:
        holds = preconditions.holds(outcomes.observation) & ~outcomes.failed
        return holds.astype(np.float64), holds

    rows = task.failures.take(open_ones) if open_ones.any() else task.failures
    return Learner(limits, rows, options=False, judge=judge, preconditions=preconditions)

"""Pretrained preconditions: learn to reach the preconditions of the nominal controllers (thesis, 5.3.3).

Preconditions are classifiers fitted offline (`preconditions`): at states of nominal runs, and at some of the failures
to learn from, controllers are started, and the outcomes are the labels. With the same primitives and failures, an
episode is rewarded, and ends, where one of them holds. Afterwards the controller that scores best there takes over.

1. Failures at which a precondition already holds are nothing to learn from, and left out of the starts.
2. Where no precondition holds at the bounds of an episode, the best-scoring controller takes over all the same.
3. The offline data of the thesis are nominal runs alone. With what controllers do at the failures themselves, PP is a
   stronger rival: it lacks only what lies between failures and nominal runs. `failures: 0` leaves them out.
"""

from __future__ import annotations

import numpy as np

from p2l.chaining.learner import ChainTask, Learner, share, whole
from p2l.chaining.mdp import Limits, Outcomes
from p2l.chaining.preconditions import at_failures, fit_offline, visit
from p2l.chaining.states import first_state
from p2l.errors import ConfigError
from p2l.records import Array, BoolArray
from p2l.seeding import generator


def learner(
    task: ChainTask,
    limits: Limits,
    *,
    trajectories: int = 300,
    every: int = 10,
    failures: int = 200,
    threshold: float = 0.5,
    precision: float | None = 0.8,
    held_out: float = 0.25,
) -> Learner:
    """Fit the preconditions offline, then reward reaching them.

    Args:
        task: of the policy.
        limits: bounds of an episode.
        trajectories: nominal ones, to fit the preconditions to.
        every: control steps between their states.
        failures: recorded ones to fit them to, too, at most.
        threshold: probability from which a precondition holds, at least.
        precision: of handovers on what is held out, for which the threshold is raised; None: it stays.
        held_out: share of the trajectories and failures that the threshold is calibrated on.

    Raises:
        ConfigError: a parameter that makes no sense.
    """
    for name, value, least in (("trajectories", trajectories, 1), ("every", every, 1), ("failures", failures, 0)):
        if not whole(value, at_least=least):
            raise ConfigError(f"pp: {name} must be an integer of at least {least}, got {value!r}")
    shares = {"threshold": threshold, "held_out": held_out} | ({} if precision is None else {"precision": precision})
    for name, number in shares.items():
        if not share(number):
            raise ConfigError(f"pp: {name} must be a number above 0 and below 1, got {number!r}")
    world, nominal = task.world, task.nominal
    rng = generator(task.seed, "pp", world.name, "fit")
    runs = world.sample(generator(task.seed, "pp", world.name, "trajectories"), trajectories)
    starts, steps = visit(world, nominal, runs, every=every)
    if failures:
        some = np.sort(rng.permutation(len(task.failures))[:failures])
        starts = starts.join(at_failures(task.failures.take(some), len(nominal), trajectories))
    offline = fit_offline(world, nominal, starts, limits.fields, threshold, precision, held_out, rng)
    preconditions = offline.preconditions
    open_ones = ~preconditions.holds(first_state(world, task.failures, limits).values)

    def judge(outcomes: Outcomes) -> tuple[Array, BoolArray]:
        holds = preconditions.holds(outcomes.observation) & ~outcomes.failed
        return holds.astype(np.float64), holds

    rows = task.failures.take(open_ones) if open_ones.any() else task.failures
    told = {
        "offline_steps": float(steps + offline.steps),
        "threshold": preconditions.threshold,
        "held_out_precision": offline.held_out_precision,
        "held_out_support": float(offline.held_out_support),
    }
    return Learner(limits, rows, options=False, judge=judge, preconditions=preconditions, told=told)

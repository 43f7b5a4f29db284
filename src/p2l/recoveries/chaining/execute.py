"""The robot's final policy: nominal where it works, recovery where a detector fires (thesis, equation 5.1).

Axis letters: N episodes, D decisions, K rows, O observation columns.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from p2l.records import Array, BoolArray, IntArray
from p2l.recoveries.chaining.learner import Act, Learner
from p2l.recoveries.chaining.mdp import Transitions, Watch
from p2l.recoveries.chaining.pool import Pool
from p2l.skills.chain import run
from p2l.skills.option import Option
from p2l.skills.runner import Reason
from p2l.worlds.world import Rows, World

BATCH = 256  # episodes at once
Progress = Callable[[int], None]


@dataclass(frozen=True)
class Agent:
    """A learnt policy with what its learner wants done around it.

    Attributes:
        learner: see there.
        act: [K] actions of the network from [K, O] states.
    """

    learner: Learner
    act: Act

    def choose(self, observation: Array, decision: IntArray) -> IntArray:
        """[K] primitives, or `len(primitives)` + a nominal option, for each row's `decision` [K] from 0 on."""
        action = self.act(observation)
        if (known := self.learner.preconditions) is not None:
            last = decision >= self.learner.limits.decisions
            best = len(self.learner.primitives) + known.best(observation)
            action = np.where(known.met(observation) | last, best, action)
        return action


@dataclass(frozen=True)
class Recovered:
    """How N recoveries went.

    Attributes:
        success: [N] the task is done.
        actions: [N, D] what was chosen, −1 after the end.
        steps: [N] control steps.
    """

    success: BoolArray
    actions: IntArray
    steps: IntArray


@dataclass(frozen=True)
class Overall:
    """N episodes of the whole robot.

    Attributes:
        nominal: [N] the nominal skills did it alone.
        flagged: [N] a detector fired, and the recovery took over.
        recovered: of the flagged ones, in order.
        success: [N] of both together.
        diverged: [N] simulation broke down; to be left out.
    """

    nominal: BoolArray
    flagged: BoolArray
    recovered: Recovered
    success: BoolArray
    diverged: BoolArray


def recover(world: World, nominal: Sequence[Option], agent: Agent, rows: Rows, watch: Watch | None = None) -> Recovered:
    """Let the agent act from each of `rows` [N], up to the bounds of its episodes.

    A terminal option hands over to the nominal chain; where a detector fires again the episode is lost.
    """
    parts = [
        _recover(world, nominal, agent, rows.take(np.arange(first, min(first + BATCH, len(rows)))), watch)
        for first in range(0, len(rows), BATCH)
    ]
    names = Recovered.__dataclass_fields__
    return Recovered(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def _recover(world: World, nominal: Sequence[Option], agent: Agent, rows: Rows, watch: Watch | None) -> Recovered:
    limits, learner = agent.learner.limits, agent.learner
    if learner.preconditions is not None:  # one decision more: the handing over
        limits = replace(limits, decisions=limits.decisions + 1, primitive_steps=limits.primitive_steps + 1)
    pool = Pool(world, nominal, learner.primitives, lambda n: rows.take(np.arange(n)), len(rows), limits)
    busy = np.ones(len(rows), dtype=np.bool_)
    actions = np.full((len(rows), limits.decisions), -1)
    count, steps = np.zeros((2, len(rows)), dtype=np.int64)
    success = np.zeros(len(rows), dtype=np.bool_)
    while busy.any():
        slots = np.flatnonzero(busy & pool.waiting)
        if len(slots):
            chosen = agent.choose(pool.observation[slots], count[slots])
            actions[slots, count[slots]] = chosen
            count[slots] += 1
            pool.act(slots, chosen)
        told: Transitions = pool.poll(watch)
        steps[told.slot] += told.steps
        success[told.slot] |= told.done & told.over
        busy[told.slot[told.over]] = False
    return Recovered(success, actions, steps)


def overall(world: World, nominal: Sequence[Option], agent: Agent, starts: Rows, *, slots: int = 64) -> Overall:
    """Run the robot from each of `starts` [N]: by equation 5.1, or by the policy alone if it learnt the whole task."""
    if agent.learner.whole_task:
        done = recover(world, nominal, agent, starts)
        none = np.zeros(len(starts), dtype=np.bool_)
        return Overall(none, ~none, done, done.success, none)
    plain = run(world, nominal, starts, slots=slots)
    flagged = plain.last.reason == Reason.FAILED
    success = plain.success.copy()
    recovered = Recovered(success[:0], np.zeros((0, 0), dtype=np.int64), np.zeros(0, dtype=np.int64))
    if flagged.any():
        recovered = recover(world, nominal, agent, plain.last.rows.take(flagged))
        success[flagged] = recovered.success
    return Overall(plain.success, flagged, recovered, success, plain.diverged)

"""The robot's final policy: nominal where it works, recovery where a detector fires (thesis, equation 5.1).

Axis letters: N episodes, D decisions, K rows, O observation columns.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from p2l.chaining.agent import Agent
from p2l.chaining.mdp import Transitions, Watch
from p2l.chaining.pool import Pool
from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import World
from p2l.records import BoolArray, IntArray
from p2l.skills.chain import Execution, run
from p2l.skills.runner import Reason

BATCH = 256  # episodes at once
Progress = Callable[[int], None]


@dataclass(frozen=True)
class RecoveryResults:
    """Results of N recoveries.

    Attributes:
        success: [N] the task is done.
        actions: [N, D] action of each decision, −1 after the end.
        steps: [N] control steps.
    """

    success: BoolArray
    actions: IntArray
    steps: IntArray


@dataclass(frozen=True)
class Overall:
    """N episodes of the whole robot.

    Attributes:
        nominal: [N] success of the nominal skills alone.
        flagged: [N] a detector fired, and the recovery took over.
        recoveries: from the flagged episodes, in order.
        success: [N] of nominal skills and recovery together.
        diverged: [N] the simulation broke down; to be excluded.
    """

    nominal: BoolArray
    flagged: BoolArray
    recoveries: RecoveryResults
    success: BoolArray
    diverged: BoolArray


def recover(
    world: World, nominal: Sequence[Option], agent: Agent, rows: Rows, watch: Watch | None = None
) -> RecoveryResults:
    """Let the agent act from each of `rows` [N], up to the bounds of its episodes.

    A terminal option hands over to the nominal chain; a second flag of a detector ends the episode as a failure.
    """
    parts = [
        _recover(world, nominal, agent, rows.take(np.arange(first, min(first + BATCH, len(rows)))), watch)
        for first in range(0, len(rows), BATCH)
    ]
    names = RecoveryResults.__dataclass_fields__
    return RecoveryResults(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def _recover(world: World, nominal: Sequence[Option], agent: Agent, rows: Rows, watch: Watch | None) -> RecoveryResults:
    limits = agent.limits
    if agent.preconditions is not None:  # one decision more: the handing over
        limits = replace(limits, decisions=limits.decisions + 1, primitive_steps=limits.primitive_steps + 1)
    pool = Pool(world, nominal, agent.primitives, lambda n: rows.take(np.arange(n)), len(rows), limits)
    busy = np.ones(len(rows), dtype=np.bool_)
    actions = np.full((len(rows), limits.decisions), -1)
    count, steps = np.zeros((2, len(rows)), dtype=np.int64)
    success = np.zeros(len(rows), dtype=np.bool_)
    while busy.any():
        slots = np.flatnonzero(busy & pool.waiting)
        if len(slots):
            action = agent.choose(pool.observation[slots], count[slots])
            actions[slots, count[slots]] = action
            count[slots] += 1
            pool.act(slots, action)
        transitions: Transitions = pool.poll(watch)
        steps[transitions.slot] += transitions.steps
        success[transitions.slot] |= transitions.done & transitions.over
        busy[transitions.slot[transitions.over]] = False
    return RecoveryResults(success, actions, steps)


def nominal_part(world: World, nominal: Sequence[Option], starts: Rows, *, slots: int = 64) -> Execution:
    """The nominal chain from each of `starts`, until it ends or a detector fires; the same for every agent."""
    return run(world, nominal, starts, slots=slots)


def overall(world: World, nominal: Sequence[Option], agent: Agent, starts: Rows, plain: Execution) -> Overall:
    """The robot from each of `starts` [N]: by equation 5.1, or the policy alone if it does the whole task.

    Args:
        world: where.
        nominal: the chain.
        agent: takes over where the chain was flagged.
        starts: [N].
        plain: the execution of `nominal_part` from them.
    """
    if agent.whole_task:
        recoveries = recover(world, nominal, agent, starts)
        every = np.ones(len(starts), dtype=np.bool_)
        return Overall(~every, every, recoveries, recoveries.success, ~every)
    flagged = plain.last.reason == Reason.FAILURE
    success = plain.success.copy()
    recoveries = RecoveryResults(success[:0], np.zeros((0, 0), dtype=np.int64), np.zeros(0, dtype=np.int64))
    if flagged.any():
        recoveries = recover(world, nominal, agent, plain.last.rows.take(flagged))
        success[flagged] = recoveries.success
    return Overall(plain.success, flagged, recoveries, success, plain.diverged)

"""Trials of macros on recorded failures, in the pool of the recovery MDP: an outcome is what any later run would have.

Axis letters: T trials, D decisions, O state columns, K rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from p2l.chaining.mdp import Limits
from p2l.chaining.pool import Pool
from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import World
from p2l.records import Array, BoolArray, IntArray


@dataclass(frozen=True)
class MacroTrials:
    """T trials.

    Attributes:
        failure: [T] which failure each started at.
        actions: [T, D] decisions that were carried out, −1 after the end.
        states: [T, D, O] the state before each of them; zeros after the end.
        success: [T] the task was done.
        steps: [T] control steps.
        timeouts: nominal options that did not end by themselves.
    """

    failure: IntArray
    actions: IntArray
    states: Array
    success: BoolArray
    steps: IntArray
    timeouts: int

    def __len__(self) -> int:
        return len(self.failure)


@dataclass
class _Queue:
    """Hands out the failures of trials in order, and remembers which trial each slot of the pool has got."""

    rows: Rows
    failure: IntArray
    given: int = 0
    last: list[int] = field(default_factory=list)

    def __call__(self, n: int) -> Rows:
        self.last = [place if place < len(self.failure) else -1 for place in range(self.given, self.given + n)]
        self.given += n
        return self.rows.take(self.failure[np.maximum(self.last, 0)])


def run_trials(
    world: World,
    nominal: Sequence[Option],
    primitives: Sequence[Option],
    rows: Rows,
    failure: IntArray,
    macros: IntArray,
    limits: Limits,
    *,
    slots: int,
) -> MacroTrials:
    """Carry out one macro from each of the failures named.

    Args:
        world: where.
        nominal: the chain π_1 … π_k.
        primitives: the agent's own actions.
        rows: recorded failures.
        failure: [T] where each trial starts, an index into `rows`.
        macros: [T, D] actions, −1 after the last.
        limits: bounds of an episode.
        slots: trials at once; they change no outcome.
    """
    count, width = len(failure), limits.decisions
    queue = _Queue(rows, np.asarray(failure))
    pool = Pool(world, nominal, primitives, queue, min(slots, count), limits)
    trial = np.array(queue.last)
    decision, steps = np.zeros((2, count), dtype=np.int64)
    success = np.zeros(count, dtype=np.bool_)
    actions = np.full((count, width), -1, dtype=np.int64)
    states = np.zeros((count, width, len(pool.columns)))
    left = count
    while left:
        ready = np.flatnonzero(pool.waiting & (trial >= 0))
        if len(ready):
            mine = trial[ready]
            action = macros[mine, decision[mine]]
            states[mine, decision[mine]], actions[mine, decision[mine]] = pool.observation[ready], action
            pool.act(ready, action)
        ended = pool.poll()
        mine = trial[ended.slot]
        decision[mine] += 1
        steps[mine] += ended.steps
        success[mine] |= ended.done & ended.over
        if ended.over.any():
            left -= int(ended.over.sum())
            trial[ended.slot[ended.over]] = queue.last
    return MacroTrials(np.asarray(failure), actions, states, success, steps, pool.timeouts)

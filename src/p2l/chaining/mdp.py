"""Types of the RecoveryChaining MDP: bounds of an episode, transitions, and the judge of their outcomes.

Axis letters: K decisions, O observation columns.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from p2l.contracts.rows import Rows
from p2l.errors import ConfigError
from p2l.records import Array, BoolArray, IntArray

Starts = Callable[[int], Rows]
Watch = Callable[[IntArray, Rows], None]


@dataclass(frozen=True)
class Limits:
    """Bounds of an episode (thesis settings).

    Attributes:
        decisions: most decisions of an episode.
        primitive_steps: most control steps spent in primitives.
        history: observations that a state is made of, the newest first.
        fields: of the observation that a state is made of; all without any.
    """

    decisions: int = 10
    primitive_steps: int = 100
    history: int = 1
    fields: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if min(self.decisions, self.primitive_steps, self.history) < 1:
            raise ConfigError(f"recovery episodes need at least one decision, control step and observation, got {self}")


@dataclass(frozen=True)
class Transitions:
    """K transitions, one for each decision whose action has ended.

    Attributes:
        slot: [K] slot of the pool.
        observation: [K, O] the state after the decision (of the ended episode where `over`).
        reward: [K] by the learner's judge; 1 where the task is done, without one of its own.
        done: [K] by the learner's judge, the goal of the episode: the task is done, or a precondition holds.
        over: [K] the episode has ended.
        fresh: [K] the episode that ended started at a recorded failure, not at a moment of an earlier success.
        cut: [K] it ended by a bound on its length, not by success, failure or an option.
        steps: [K] control steps the decision took.
        next_observation: [K, O] state of the slot's next decision: `observation`, or a new episode's start.
    """

    slot: IntArray
    observation: Array
    reward: Array
    done: BoolArray
    over: BoolArray
    fresh: BoolArray
    cut: BoolArray
    steps: IntArray
    next_observation: Array


@dataclass(frozen=True)
class Outcomes:
    """Outcomes of K decisions, from which a judge takes reward and termination.

    Attributes:
        before, after: [K] the moments before and after.
        observation: [K, O] the state after.
        done: [K] the task is done, and no detector has fired.
        failed: [K] a detector has fired, or the simulation broke down.
    """

    before: Rows
    after: Rows
    observation: Array
    done: BoolArray
    failed: BoolArray


Judge = Callable[[Outcomes], tuple[Array, BoolArray]]


def task_success(outcomes: Outcomes) -> tuple[Array, BoolArray]:
    """The MDP's own judge: reward 1 where the task is done, which ends the episode."""
    return outcomes.done.astype(np.float64), outcomes.done

"""Decisions of many slots, gathered into the trajectories that a policy-gradient learner wants.

Slots decide at their own pace, so a rollout is not a rectangle of steps × slots. Decisions are ordered by the end of
their action; a rollout takes the first of them, groups them by slot, and cuts where an episode or the rollout ends.
Pending and surplus decisions stay for the next rollout, with the log-probability of their time.

Axis letters: B slots, K decisions, O observation columns.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from p2l.chaining.mdp import Transitions
from p2l.records import Array, BoolArray, IntArray


@dataclass(frozen=True)
class Decisions:
    """K decisions, trajectory after trajectory.

    Attributes:
        slot: [K] slot of the pool.
        observation: [K, O] the state before the decision.
        action: [K].
        value: [K] of the observation, by the critic at that time.
        log_prob: [K] of the action, by the actor at that time.
        reward: [K].
        head: [K] first of its trajectory.
        open_end: [K] last of a trajectory that continues after the rollout: its return is bootstrapped by the critic.
        after: [K, O] the state after the decision.
    """

    slot: IntArray
    observation: Array
    action: IntArray
    value: Array
    log_prob: Array
    reward: Array
    head: BoolArray
    open_end: BoolArray
    after: Array


@dataclass(frozen=True)
class _Choice:
    """A decision whose action has not ended yet."""

    observation: Array
    action: int
    value: float
    log_prob: float


@dataclass(frozen=True)
class _Transition:
    """A decision with its outcome."""

    slot: int
    choice: _Choice
    reward: float
    after: Array
    over: bool


class Gatherer:
    """Collects decisions and their outcomes."""

    def __init__(self) -> None:
        self._pending: dict[int, _Choice] = {}
        self._transitions: list[_Transition] = []

    def __len__(self) -> int:
        """Number of transitions for the next rollout."""
        return len(self._transitions)

    def decide(self, slots: IntArray, observation: Array, action: IntArray, value: Array, log_prob: Array) -> None:
        """Add the decisions [K] of `slots` [K]."""
        choices = zip(slots.tolist(), observation, action.tolist(), value.tolist(), log_prob.tolist(), strict=True)
        self._pending |= {slot: _Choice(*rest) for slot, *rest in choices}

    def add(self, transitions: Transitions) -> None:
        """Add the outcomes of decisions."""
        for place, slot in enumerate(transitions.slot.tolist()):
            over, reward, after = (
                bool(transitions.over[place]),
                float(transitions.reward[place]),
                transitions.observation[place],
            )
            self._transitions.append(_Transition(slot, self._pending.pop(slot), reward, after, over))

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Decisions whose actions go on, and surplus ones, for a checkpoint."""
        slots, pending, surplus = list(self._pending), list(self._pending.values()), self._transitions
        choices = [*pending, *(one.choice for one in surplus)]
        if not choices:
            return {}
        state = {
            "pending": np.array(slots, dtype=np.int64),
            "slot": np.array([one.slot for one in surplus], dtype=np.int64),
            "reward": np.array([one.reward for one in surplus], dtype=np.float64),
            "over": np.array([one.over for one in surplus], dtype=np.bool_),
            "observation": np.stack([one.observation for one in choices]),
            "action": np.array([one.action for one in choices], dtype=np.int64),
            "value": np.array([one.value for one in choices], dtype=np.float64),
            "log_prob": np.array([one.log_prob for one in choices], dtype=np.float64),
        }
        return state | ({"after": np.stack([one.after for one in surplus])} if surplus else {})

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """From what `state` gave."""
        self._pending, self._transitions = {}, []
        if not state:
            return
        numbers = (state[name].tolist() for name in ("action", "value", "log_prob"))
        choices = [_Choice(*one) for one in zip(state["observation"], *numbers, strict=True)]
        slots = state["pending"].tolist()
        self._pending = dict(zip(slots, choices[: len(slots)], strict=True))
        outcomes = zip(state["slot"].tolist(), state["reward"].tolist(), state["over"].tolist(), strict=True)
        for place, (slot, reward, over) in enumerate(outcomes):
            self._transitions.append(
                _Transition(slot, choices[len(slots) + place], reward, state["after"][place], over)
            )

    def take(self, count: int) -> Decisions:
        """The first `count` decisions, grouped by slot."""
        transitions, self._transitions = self._transitions[:count], self._transitions[count:]
        transitions = sorted(transitions, key=lambda one: one.slot)  # stable: a slot's decisions stay in order
        following = [one.slot for one in transitions[1:]] + [-1]
        last = np.array([one.over or one.slot != after for one, after in zip(transitions, following, strict=True)])
        return Decisions(
            slot=np.array([one.slot for one in transitions]),
            observation=np.stack([one.choice.observation for one in transitions]),
            action=np.array([one.choice.action for one in transitions]),
            value=np.array([one.choice.value for one in transitions]),
            log_prob=np.array([one.choice.log_prob for one in transitions]),
            reward=np.array([one.reward for one in transitions]),
            head=np.concatenate([[True], last[:-1]]),
            open_end=last & np.array([not one.over for one in transitions]),
            after=np.stack([one.after for one in transitions]),
        )

"""Decisions of many slots, gathered into the trajectories that a policy-gradient learner wants.

Slots decide at their own pace, so a rollout is not a rectangle of steps × slots. Decisions are ordered as they have
played out; a rollout takes the first of them, groups them by slot, and cuts where an episode ends or the rollout does.
What is pending, or more than asked for, stays for the next rollout, with the probability that it was chosen with.

Axis letters: B slots, K decisions, O observation columns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p2l.chaining.mdp import Transitions
from p2l.records import Array, BoolArray, IntArray


@dataclass(frozen=True)
class Decisions:
    """K decisions, trajectory after trajectory.

    Attributes:
        slot: [K] where.
        observation: [K, O] what it was made on.
        action: [K].
        value: [K] of the observation, by the critic at that time.
        log_prob: [K] of the action, by the actor at that time.
        reward: [K].
        head: [K] first of its trajectory.
        open_end: [K] last of a trajectory that goes on after the rollout: its future is worth what the critic says of
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
    """One decision, when made."""

    observation: Array
    action: int
    value: float
    log_prob: float


@dataclass(frozen=True)
class _Played:
    """One decision, played out."""

    slot: int
    choice: _Choice
    reward: float
    after: Array
    over: bool


class Gatherer:
    """Remembers what is under way."""

    def __init__(self) -> None:
        self._pending: dict[int, _Choice] = {}
        self._played: list[_Played] = []

    def __len__(self) -> int:
        """Decisions that have played out and that no rollout has taken."""
        return len(self._played)

    def decide(self, slots: IntArray, observation: Array, action: IntArray, value: Array, log_prob: Array) -> None:
        """Decisions have been made in `slots` [K]."""
        told = zip(slots.tolist(), observation, action.tolist(), value.tolist(), log_prob.tolist(), strict=True)
        self._pending |= {slot: _Choice(*rest) for slot, *rest in told}

    def add(self, told: Transitions) -> None:
        """Decisions have played out."""
        for place, slot in enumerate(told.slot.tolist()):
            over, reward, after = bool(told.over[place]), float(told.reward[place]), told.observation[place]
            self._played.append(_Played(slot, self._pending.pop(slot), reward, after, over))

    def take(self, count: int) -> Decisions:
        """The first `count` decisions, grouped by slot."""
        taken, self._played = self._played[:count], self._played[count:]
        taken = sorted(taken, key=lambda one: one.slot)  # stable: a slot's decisions stay in order
        following = [one.slot for one in taken[1:]] + [-1]
        last = np.array([one.over or one.slot != after for one, after in zip(taken, following, strict=True)])
        return Decisions(
            slot=np.array([one.slot for one in taken]),
            observation=np.stack([one.choice.observation for one in taken]),
            action=np.array([one.choice.action for one in taken]),
            value=np.array([one.choice.value for one in taken]),
            log_prob=np.array([one.choice.log_prob for one in taken]),
            reward=np.array([one.reward for one in taken]),
            head=np.concatenate([[True], last[:-1]]),
            open_end=last & np.array([not one.over for one in taken]),
            after=np.stack([one.after for one in taken]),
        )

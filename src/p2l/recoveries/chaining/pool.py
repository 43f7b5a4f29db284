"""The RecoveryChaining MDP over the batched engine, without a row ever waiting for another (thesis, section 5.3.2).

A pool has slots; each holds one episode that starts at a recorded failure. `act` gives decisions to slots that wait
for one, `poll` carries all busy slots through control steps until at least one decision has played out. A primitive
lasts a few control steps; a nominal option (π_i … π_k) lasts many, ends the episode, and is paid with task success.

The MDP: state = the deployable observation, with a short history where the world is partially observed; actions = the
primitives, then one terminal option per nominal controller; reward 1 where the task is done, by an option or by
primitives on their own, else 0; failure flags absorb, and end an option's simulation early.

Deviations from the thesis, and readings of it:
1. At the start the detector that fired is often still firing (the hand presses on what it hit). Flags count from the
   first control step on that raises none; otherwise no first action could be anything but a failure.
2. Time is counted in control steps, options included, so that methods with long options are charged for them.

Axis letters: B slots, K transitions, O observation columns, A actions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from p2l.errors import ConfigError
from p2l.records import Array, BoolArray, IntArray
from p2l.skills.option import Option
from p2l.skills.runner import Reason, Runner
from p2l.worlds.observation import Observation
from p2l.worlds.world import Rows, World

Starts = Callable[[int], Rows]


@dataclass(frozen=True)
class Limits:
    """Bounds of an episode (thesis settings).

    Attributes:
        decisions: most decisions of an episode.
        primitive_steps: most control steps spent in primitives.
        history: observations that a state is made of, the newest first.
    """

    decisions: int = 10
    primitive_steps: int = 100
    history: int = 1


@dataclass(frozen=True)
class Transitions:
    """K decisions that have played out.

    Attributes:
        slot: [K] where.
        observation: [K, O] the state after the decision (of the ended episode where `over`).
        reward: [K] 1 where the task is done.
        over: [K] the episode has ended.
        cut: [K] it ended by a bound on its length, not by success, failure or an option: not a terminal state.
        steps: [K] control steps the decision took.
        next_observation: [K, O] what the slot's next decision is made on: `observation`, or a new episode's start.
    """

    slot: IntArray
    observation: Array
    reward: Array
    over: BoolArray
    cut: BoolArray
    steps: IntArray
    next_observation: Array


class Pool:
    """Slots of recovery episodes.

    Args:
        world: where.
        nominal: the chain π_1 … π_k.
        primitives: the agent's own actions.
        starts: gives n recorded failures to start from.
        slots: B.
        limits: bounds of an episode.
    """

    def __init__(
        self,
        world: World,
        nominal: Sequence[Option],
        primitives: Sequence[Option],
        starts: Starts,
        slots: int,
        limits: Limits | None = None,
    ) -> None:
        self.world, self.limits = world, limits or Limits()
        if self.limits.history < 1 or self.limits.decisions < 1:
            raise ConfigError(f"recovery episodes need at least one decision and one observation, got {self.limits}")
        self._primitives, self._chain = len(primitives), len(nominal)
        self.actions = tuple([option.name for option in primitives] + [f"from {option.name}" for option in nominal])
        self._starts = starts
        self._runner = Runner(world, (*primitives, *nominal), slots)
        self._history: list[Array] = []
        self._decisions = np.zeros(slots, dtype=np.int64)
        self._primitive_steps = np.zeros(slots, dtype=np.int64)
        self._before = np.zeros(slots, dtype=np.int64)
        self._columns: tuple[str, ...] = ()
        self.control_steps = 0
        every = np.arange(slots)
        self.waiting = np.ones(slots, dtype=np.bool_)
        self._renew(every)

    def __len__(self) -> int:
        return len(self.waiting)

    @property
    def columns(self) -> tuple[str, ...]:
        """O names of the state's columns."""
        return self._columns

    @property
    def observation(self) -> Array:
        """[B, O] the present state of every slot; meaningful where `waiting`."""
        return np.concatenate(self._history, axis=1)

    def act(self, slots: IntArray, actions: IntArray) -> None:
        """Start `actions` [K] in `slots` [K].

        Raises:
            ConfigError: a slot is not waiting, or there is no such action.
        """
        if not self.waiting[slots].all():
            raise ConfigError(f"pool: slots {slots[~self.waiting[slots]].tolist()} are busy; poll first")
        if not np.isin(actions, np.arange(len(self.actions))).all():
            raise ConfigError(f"pool: actions must lie in [0, {len(self.actions)}), got {actions.tolist()}")
        self.waiting[slots] = False
        self._before[slots] = self._runner.steps_total[slots]
        self._runner.begin(slots, actions)

    def poll(self) -> Transitions:
        """Advance until at least one decision has played out.

        Raises:
            ConfigError: nobody is busy.
        """
        if not self._runner.busy.any():
            raise ConfigError("pool: every slot waits for a decision; act first")
        while True:
            before = int(self._runner.steps_total.sum())
            events = self._runner.advance()
            self.control_steps += int(self._runner.steps_total.sum()) - before
            going = self._goes_on(events.slot, events.reason)
            if going.any():
                self._runner.begin(events.slot[going], self._runner.option[events.slot[going]] + 1)
            if (~going).any():
                return self._transitions(events.slot[~going], events.reason[~going])

    def _goes_on(self, slot: IntArray, reason: IntArray) -> BoolArray:
        """[K] whether a nominal option has ended and is followed by the next of the chain."""
        option = self._runner.option[slot]
        inside = (option >= self._primitives) & (option + 1 < self._primitives + self._chain)
        return inside & ((reason == Reason.ENDED) | (reason == Reason.TIMEOUT))

    def _transitions(self, slot: IntArray, reason: IntArray) -> Transitions:
        rows = self._runner.rows.take(slot)
        nominal = self._runner.option[slot] >= self._primitives
        steps = self._runner.steps_total[slot] - self._before[slot]
        failed = (reason == Reason.FAILED) | (reason == Reason.DIVERGED)
        reward = (self.world.goal(rows) & ~failed).astype(np.float64)
        self._decisions[slot] += 1
        self._primitive_steps[slot] += np.where(nominal, 0, steps)
        spent = self._decisions[slot] >= self.limits.decisions
        spent |= self._primitive_steps[slot] >= self.limits.primitive_steps
        ended = nominal | failed | (reward > 0.0)
        over = ended | spent
        self._observe(slot)
        observation = self.observation[slot].copy()
        if over.any():
            self._renew(slot[over])
        self.waiting[slot] = True
        return Transitions(slot, observation, reward, over, over & ~ended, steps, self.observation[slot].copy())

    def _renew(self, slots: IntArray) -> None:
        """New episodes from recorded failures."""
        rows = self._starts(len(slots))
        first = np.zeros(len(slots), dtype=np.int64)
        self._runner.start(slots, rows, first, muted=True)
        self._runner.stop(slots)
        self._decisions[slots] = 0
        self._primitive_steps[slots] = 0
        seen = self.world.observe(rows)
        if not self._history:
            self._history = [np.zeros((len(self), seen.values.shape[1])) for _ in range(self.limits.history)]
            self._columns = Observation.stack([seen] * self.limits.history).names
        for past in self._history:  # before the failure there is nothing to remember: the start repeats
            past[slots] = seen.values

    def _observe(self, slots: IntArray) -> None:
        """Shift the history of `slots` and put the present observation first."""
        for newer, older in zip(reversed(self._history[:-1]), reversed(self._history[1:]), strict=True):
            older[slots] = newer[slots]
        self._history[0][slots] = self.world.observe(self._runner.rows.take(slots)).values

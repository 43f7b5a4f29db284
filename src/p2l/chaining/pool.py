"""The RecoveryChaining MDP over the batched engine, without a row ever waiting for another (thesis, section 5.3.2).

A pool has slots; each holds one episode, from a recorded failure on. `act` starts actions in slots that wait for one,
`poll` simulates all busy slots until at least one action has ended. A primitive lasts a few control steps; a nominal
option (π_i … π_k) lasts many, ends the episode, and is rewarded by task success.

The MDP: state = the deployable observation, with a short history where the world is partially observed; actions = the
primitives, then one terminal option per nominal controller; reward 1 where the task is done, by an option or by
primitives on their own, else 0; failure flags absorb, and end an option's simulation early.

Deviations from the thesis, and readings of it:
1. At the start the detector that fired is often still firing (the hand presses on what it hit). Flags count from the
   first control step on that raises none; otherwise no first action could be anything but a failure.
2. Time is counted in control steps, options included, so that long options cost budget.
3. A learner may have a reward of its own (a precondition, a dense reward), have no nominal options, or end an episode
   without simulation (`settle`); it is the same MDP otherwise.
4. Some episodes may start at moments of earlier successes instead of a recorded failure (`revisit`).

Axis letters: B slots, K decisions, O observation columns.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from p2l.artifacts import part
from p2l.chaining.mdp import Judge, Limits, Outcomes, Starts, Transitions, Watch, task_success
from p2l.chaining.revisit import RevisitMoments, Revisits
from p2l.chaining.states import action_names, sound, state_columns, state_fields
from p2l.contracts.observation import Observation
from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import World
from p2l.errors import ConfigError, ShapeError
from p2l.records import Array, BoolArray, IntArray
from p2l.skills.runner import Reason, open_runner

_STATE = ("waiting", "_decisions", "_primitive_steps", "_steps_before", "control_steps", "timeouts")


class Pool:
    """Slots of recovery episodes.

    Args:
        world: of the task.
        nominal: the chain π_1 … π_k.
        primitives: the agent's own actions.
        starts: gives n recorded failures as start states.
        slots: B.
        limits: bounds of an episode.
        judge: the reward of each decision [K], and whether it reaches the goal of the episode [K], which ends it.
        revisits: moments of earlier successes to start from; None: all episodes start at recorded failures.

    Attributes:
        waiting: [B] slots that wait for an action.
        control_steps: simulated so far.
        timeouts: nominal options that did not end by themselves.
    """

    def __init__(
        self,
        world: World,
        nominal: Sequence[Option],
        primitives: Sequence[Option],
        starts: Starts,
        slots: int,
        limits: Limits | None = None,
        judge: Judge = task_success,
        revisits: Revisits | None = None,
    ) -> None:
        self.world, self.limits, self._judge, self._revisits = world, limits or Limits(), judge, revisits
        self._primitives, self._chain = len(primitives), len(nominal)
        self.actions = action_names(primitives, nominal)
        self._starts = starts
        self._runner = open_runner(world, (*primitives, *nominal), slots)
        self._history: list[Array] = []
        self._option_observation: Observation | None = None  # [B] for the next option; valid where `waiting`
        self._decisions = np.zeros(slots, dtype=np.int64)
        self._primitive_steps = np.zeros(slots, dtype=np.int64)
        self._steps_before = np.zeros(slots, dtype=np.int64)
        self._columns: tuple[str, ...] = ()
        self._state_columns = np.zeros(0, dtype=np.int64)  # of an observation, those that make up a state
        self.control_steps = self.timeouts = 0
        self.waiting = np.ones(slots, dtype=np.bool_)
        self.reset()

    def __len__(self) -> int:
        return len(self.waiting)

    @property
    def columns(self) -> tuple[str, ...]:
        """O names of the state's columns."""
        return self._columns

    @property
    def observation(self) -> Array:
        """[B, O] the present state of every slot; valid where `waiting`."""
        return np.concatenate(self._history, axis=1)

    def reset(self) -> None:
        """Start a new episode in every slot; unfinished ones are dropped."""
        every = np.arange(len(self))
        self.waiting[every] = True
        if self._revisits is not None:
            self._revisits.forget(every)
        self._renew(every)
        self._rows_before = self._runner.rows.take(every)

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Everything that decides its future but the generator of its starts, for a checkpoint."""
        state: dict[str, npt.NDArray[Any]] = {name: np.asarray(getattr(self, name)) for name in _STATE}
        state |= {f"history.{place}": past for place, past in enumerate(self._history)}
        state |= {f"before.{name}": value for name, value in self._rows_before.arrays().items()}
        state |= {f"runner.{name}": value for name, value in self._runner.state().items()}
        if self._option_observation is not None:
            state["option_observation"] = self._option_observation.values
        if self._revisits is not None:
            state |= {f"revisits.{name}": value for name, value in self._revisits.state().items()}
        return state

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """From what `state` gave, of a pool of the same MDP and slots."""
        for name in ("waiting", "_decisions", "_primitive_steps", "_steps_before"):
            getattr(self, name)[:] = state[name]
        self.control_steps, self.timeouts = int(state["control_steps"]), int(state["timeouts"])
        for place, past in enumerate(self._history):
            past[:] = state[f"history.{place}"]
        self._rows_before = Rows.from_arrays(part(state, "before."))
        self._runner.restore(part(state, "runner."))
        if self._option_observation is not None:
            self._option_observation.values[:] = state["option_observation"]
        if self._revisits is not None:
            self._revisits.restore(part(state, "revisits."))

    def act(self, slots: IntArray, actions: IntArray) -> None:
        """Start `actions` [K] in `slots` [K].

        Raises:
            ConfigError: a slot is busy, named twice or unknown, or there is no such action.
        """
        self._refuse_unknown(slots, actions)
        self._refuse_busy(slots)
        if not ((actions >= 0) & (actions < len(self.actions)) & (actions == np.floor(actions))).all():
            raise ConfigError(f"pool: actions must lie in [0, {len(self.actions)}), got {actions.tolist()}")
        self.waiting[slots] = False
        self._steps_before[slots] = self._runner.steps_total[slots]
        rows = self._runner.rows.take(slots)
        self._rows_before.put(slots, rows)
        self._record(slots, rows)
        seen = self._option_observation
        self._runner.begin(slots, actions, None if seen is None else seen.take(slots))

    def settle(self, slots: IntArray, reward: Array) -> Transitions:
        """End the episodes of `slots` [K] with `reward` [K], without simulation; `done` where it is positive.

        Raises:
            ConfigError: a slot is not waiting.
        """
        self._refuse_busy(slots)
        observation = self._state(slots)
        self._record(slots, self._runner.rows.take(slots))
        fresh = self._leave(slots, reward > 0.0, simulated=False)
        no, steps = np.zeros(len(slots), dtype=np.bool_), np.zeros(len(slots), dtype=np.int64)
        return Transitions(slots, observation, reward, reward > 0.0, ~no, fresh, no, steps, self._state(slots))

    def poll(self, watch: Watch | None = None) -> Transitions:
        """Advance until at least one action has ended.

        Args:
            watch: called after every control step with the busy slots and their rows.

        Raises:
            ConfigError: no slot is busy.
            ShapeError: a reward or an observation is not finite.
        """
        if not self._runner.busy.any():
            raise ConfigError("pool: every slot waits for a decision; act first")
        while True:
            before, busy = int(self._runner.steps_total.sum()), np.flatnonzero(self._runner.busy)
            events = self._runner.advance(by_step=watch is not None)
            self.control_steps += int(self._runner.steps_total.sum()) - before
            if watch is not None:
                watch(busy, self._runner.rows.take(busy))
            nominal = self._runner.option[events.slot] >= self._primitives
            self.timeouts += int((nominal & (events.reason == Reason.TIMEOUT)).sum())
            going = self._goes_on(events.slot, events.reason)
            if going.any():
                self._runner.begin(events.slot[going], self._runner.option[events.slot[going]] + 1)
            if (~going).any():
                return self._transitions(events.slot[~going], events.reason[~going])

    def _goes_on(self, slot: IntArray, reason: IntArray) -> BoolArray:
        """[K] whether a nominal option has ended and the next of the chain follows."""
        option = self._runner.option[slot]
        inside = (option >= self._primitives) & (option + 1 < self._primitives + self._chain)
        return inside & ((reason == Reason.TERMINATION) | (reason == Reason.TIMEOUT))

    def _transitions(self, slot: IntArray, reason: IntArray) -> Transitions:
        rows = self._runner.rows.take(slot)
        nominal = self._runner.option[slot] >= self._primitives
        steps = self._runner.steps_total[slot] - self._steps_before[slot]
        failed = (reason == Reason.FAILURE) | (reason == Reason.DIVERGENCE)
        done = self.world.goal(rows) & ~failed
        self._decisions[slot] += 1
        self._primitive_steps[slot] += np.where(nominal, 0, steps)
        at_bound = self._decisions[slot] >= self.limits.decisions
        at_bound |= self._primitive_steps[slot] >= self.limits.primitive_steps
        self._observe(slot, rows)
        observation = self._state(slot)
        reward, ends = self._judge(Outcomes(self._rows_before.take(slot), rows, observation, done, failed))
        if not np.isfinite(reward).all():
            raise ShapeError(f"{self.world.name}: the reward of a decision is NaN or infinite")
        terminal = nominal | failed | ends
        over, fresh = terminal | at_bound, np.ones(len(slot), dtype=np.bool_)
        if over.any():
            fresh[over] = self._leave(slot[over], ends[over])
        self.waiting[slot] = True
        return Transitions(slot, observation, reward, ends, over, fresh, over & ~terminal, steps, self._state(slot))

    def _renew(self, slots: IntArray) -> None:
        """New episodes from recorded failures."""
        rows = self._starts(len(slots))
        self._runner.place(slots, rows, muted=True)
        self._decisions[slots] = self._primitive_steps[slots] = 0
        observation = self._look(slots, rows)
        if not self._history:
            state = state_fields(observation, self.limits)
            self._history = [np.zeros((len(self), state.values.shape[1])) for _ in range(self.limits.history)]
            self._columns = Observation.stack([state] * self.limits.history).names
            self._state_columns = state_columns(observation, self.limits)
        for past in self._history:  # nothing precedes the failure: the start repeats
            past[slots] = observation.values[:, self._state_columns]

    def _leave(self, slots: IntArray, success: BoolArray, *, simulated: bool = True) -> BoolArray:
        """End the episodes of `slots` [K] and start others; returns which of them [K] started at a recorded failure."""
        if self._revisits is None:
            self._renew(slots)
            return np.ones(len(slots), dtype=np.bool_)
        fresh = self._revisits.fresh[slots]
        self._revisits.end(slots, success, simulated=simulated)
        self._renew(slots)
        back, moments = self._revisits.begin(slots)
        if moments is not None and len(back):
            self._go_back(back, moments)
        return fresh

    def _go_back(self, slots: IntArray, moments: RevisitMoments) -> None:
        self._runner.place(slots, moments.rows, moments.muted)
        self._look(slots, moments.rows)
        self._decisions[slots] = moments.decisions
        self._primitive_steps[slots] = moments.primitive_steps
        for past, columns in zip(self._history, np.split(moments.state, len(self._history), axis=1), strict=True):
            past[slots] = columns

    def _record(self, slots: IntArray, rows: Rows) -> None:
        """Record the moments of decisions for `revisits`."""
        if self._revisits is not None:
            moments = RevisitMoments(
                rows=rows,
                state=self._state(slots),
                decisions=self._decisions[slots],
                primitive_steps=self._primitive_steps[slots],
                muted=self._runner.muted[slots],
            )
            self._revisits.record(slots, moments)

    def _state(self, slots: IntArray) -> Array:
        """[K, O] the present state of `slots` [K]."""
        return np.concatenate([past[slots] for past in self._history], axis=1)

    def _observe(self, slots: IntArray, rows: Rows) -> None:
        """Shift the history of `slots` [K] and put the present observation of their `rows` [K] first."""
        for newer, older in zip(reversed(self._history[:-1]), reversed(self._history[1:]), strict=True):
            older[slots] = newer[slots]
        self._history[0][slots] = self._look(slots, rows).values[:, self._state_columns]

    def _look(self, slots: IntArray, rows: Rows) -> Observation:
        """The observation of the `rows` [K] of `slots` [K], which the next options start from, too."""
        observation = sound(self.world, rows)
        if self._option_observation is None:
            blank = np.zeros((len(self), observation.values.shape[1]))
            self._option_observation = Observation(observation.columns, blank)
        self._option_observation.values[slots] = observation.values
        return observation

    def _refuse_unknown(self, slots: IntArray, actions: IntArray) -> None:
        valid = slots.dtype.kind == "i" and slots.ndim == 1 and slots.shape == actions.shape
        if not valid or ((slots < 0) | (slots >= len(self))).any() or len(np.unique(slots)) < len(slots):
            raise ConfigError(
                f"pool: slots must be different integers in [0, {len(self)}), one for each of {actions.size} actions, "
                f"got {slots.tolist()}"
            )

    def _refuse_busy(self, slots: IntArray) -> None:
        if not self.waiting[slots].all():
            raise ConfigError(f"pool: slots {slots[~self.waiting[slots]].tolist()} are busy; poll first")

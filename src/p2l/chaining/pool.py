"""The RecoveryChaining MDP over the batched engine, without a row ever waiting for another (thesis, section 5.3.2).

A pool has slots; each holds one episode, from a recorded failure on. `act` gives decisions to slots that wait
for one, `poll` carries all busy slots through control steps until at least one decision has played out. A primitive
lasts a few control steps; a nominal option (π_i … π_k) lasts many, ends the episode, and is paid with task success.

The MDP: state = the deployable observation, with a short history where the world is partially observed; actions = the
primitives, then one terminal option per nominal controller; reward 1 where the task is done, by an option or by
primitives on their own, else 0; failure flags absorb, and end an option's simulation early.

Deviations from the thesis, and readings of it:
1. At the start the detector that fired is often still firing (the hand presses on what it hit). Flags count from the
   first control step on that raises none; otherwise no first action could be anything but a failure.
2. Time is counted in control steps, options included, so that methods with long options are charged for them.
3. A learner may judge decisions in its own way (a learnt precondition, a dense reward), have no nominal options, or
   end an episode unsimulated (`settle`); it is the same MDP otherwise.
4. Some episodes may go on from moments of earlier successes instead of a recorded failure (`revisit`).

Axis letters: B slots, K decisions, O observation columns.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from p2l.chaining.mdp import Judge, Limits, Played, Starts, Transitions, Watch, task_success
from p2l.chaining.revisit import RevisitMoments, Revisits
from p2l.contracts.observation import Observation
from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import World
from p2l.errors import ConfigError, ShapeError
from p2l.records import Array, BoolArray, IntArray
from p2l.skills.runner import Reason, Runner


class Pool:
    """Slots of recovery episodes.

    Args:
        world: where.
        nominal: the chain π_1 … π_k.
        primitives: the agent's own actions.
        starts: gives n recorded failures to start from.
        slots: B.
        limits: bounds of an episode.
        judge: the reward of each decision [K], and whether it does what the episode is for [K], which ends it.
        revisits: lets episodes go on from moments of earlier successes; none: all start at recorded failures.

    Attributes:
        waiting: [B] slots that wait for a decision.
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
        self._runner = Runner(world, (*primitives, *nominal), slots)
        self._history: list[Array] = []
        self._seen: Observation | None = None  # [B] what options begin with; meaningful where `waiting`
        self._decisions = np.zeros(slots, dtype=np.int64)
        self._primitive_steps = np.zeros(slots, dtype=np.int64)
        self._before = np.zeros(slots, dtype=np.int64)
        self._columns: tuple[str, ...] = ()
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
        """[B, O] the present state of every slot; meaningful where `waiting`."""
        return np.concatenate(self._history, axis=1)

    def reset(self) -> None:
        """A new episode in every slot, whatever is under way."""
        every = np.arange(len(self))
        self.waiting[every] = True
        if self._revisits is not None:
            self._revisits.forget(every)
        self._renew(every)
        self._begun = self._runner.rows.take(every)

    def act(self, slots: IntArray, actions: IntArray) -> None:
        """Start `actions` [K] in `slots` [K].

        Raises:
            ConfigError: a slot is not waiting, is named twice, or not one of the pool's, or there is no such action.
        """
        self._refuse_unknown(slots, actions)
        self._refuse_busy(slots)
        if not np.isin(actions, np.arange(len(self.actions))).all():
            raise ConfigError(f"pool: actions must lie in [0, {len(self.actions)}), got {actions.tolist()}")
        self.waiting[slots] = False
        self._before[slots] = self._runner.steps_total[slots]
        rows = self._runner.rows.take(slots)
        self._begun.put(slots, rows)
        self._pass(slots, rows)
        self._runner.begin(slots, actions, None if self._seen is None else self._seen.take(slots))

    def settle(self, slots: IntArray, reward: Array) -> Transitions:
        """End the episodes of `slots` [K] with `reward` [K], simulating nothing; `done` says whether it is positive.

        Raises:
            ConfigError: a slot is not waiting.
        """
        self._refuse_busy(slots)
        observation = self.observation[slots].copy()
        self._pass(slots, self._runner.rows.take(slots))
        fresh = self._leave(slots, reward > 0.0, simulated=False)
        yes, no = np.ones(len(slots), dtype=np.bool_), np.zeros(len(slots), dtype=np.bool_)
        steps = np.zeros(len(slots), dtype=np.int64)
        return Transitions(
            slots, observation, reward, reward > 0.0, yes, fresh, no, steps, self.observation[slots].copy()
        )

    def poll(self, watch: Watch | None = None) -> Transitions:
        """Advance until at least one decision has played out.

        Args:
            watch: told after every control step which slots were busy, and their rows.

        Raises:
            ConfigError: nobody is busy.
            ShapeError: a reward or an observation is not finite.
        """
        if not self._runner.busy.any():
            raise ConfigError("pool: every slot waits for a decision; act first")
        while True:
            before, busy = int(self._runner.steps_total.sum()), np.flatnonzero(self._runner.busy)
            events = self._runner.advance()
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
        """[K] whether a nominal option has ended and is followed by the next of the chain."""
        option = self._runner.option[slot]
        inside = (option >= self._primitives) & (option + 1 < self._primitives + self._chain)
        return inside & ((reason == Reason.ENDED) | (reason == Reason.TIMEOUT))

    def _transitions(self, slot: IntArray, reason: IntArray) -> Transitions:
        rows = self._runner.rows.take(slot)
        nominal = self._runner.option[slot] >= self._primitives
        steps = self._runner.steps_total[slot] - self._before[slot]
        failed = (reason == Reason.FAILED) | (reason == Reason.DIVERGED)
        done = self.world.goal(rows) & ~failed
        self._decisions[slot] += 1
        self._primitive_steps[slot] += np.where(nominal, 0, steps)
        spent = self._decisions[slot] >= self.limits.decisions
        spent |= self._primitive_steps[slot] >= self.limits.primitive_steps
        self._observe(slot)
        observation = self.observation[slot].copy()
        reward, ends = self._judge(Played(self._begun.take(slot), rows, observation, done, failed))
        if not np.isfinite(reward).all():
            raise ShapeError(f"{self.world.name}: the reward of a decision is NaN or infinite")
        ended = nominal | failed | ends
        over, fresh = ended | spent, np.ones(len(slot), dtype=np.bool_)
        if over.any():
            fresh[over] = self._leave(slot[over], ends[over])
        self.waiting[slot] = True
        cut, following = over & ~ended, self.observation[slot].copy()
        return Transitions(slot, observation, reward, ends, over, fresh, cut, steps, following)

    def _renew(self, slots: IntArray) -> None:
        """New episodes from recorded failures."""
        rows = self._starts(len(slots))
        self._runner.place(slots, rows, muted=True)
        self._decisions[slots] = 0
        self._primitive_steps[slots] = 0
        seen = chosen(self._look(slots, rows), self.limits)
        if not self._history:
            self._history = [np.zeros((len(self), seen.values.shape[1])) for _ in range(self.limits.history)]
            self._columns = Observation.stack([seen] * self.limits.history).names
        for past in self._history:  # before the failure there is nothing to remember: the start repeats
            past[slots] = seen.values

    def _leave(self, slots: IntArray, paid: BoolArray, *, simulated: bool = True) -> BoolArray:
        """Episodes have ended; others begin. Returns which of the ended ones [K] had started at a recorded failure."""
        if self._revisits is None:
            self._renew(slots)
            return np.ones(len(slots), dtype=np.bool_)
        fresh = self._revisits.fresh[slots]
        self._revisits.ended(slots, paid, simulated=simulated)
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
        for past, part in zip(self._history, np.split(moments.state, len(self._history), axis=1), strict=True):
            past[slots] = part

    def _pass(self, slots: IntArray, rows: Rows) -> None:
        """Note where a decision is taken."""
        if self._revisits is not None:
            moments = RevisitMoments(
                rows=rows,
                state=self.observation[slots],
                decisions=self._decisions[slots],
                primitive_steps=self._primitive_steps[slots],
                muted=self._runner.muted[slots],
            )
            self._revisits.passing(slots, moments)

    def _observe(self, slots: IntArray) -> None:
        """Shift the history of `slots` and put the present observation first."""
        for newer, older in zip(reversed(self._history[:-1]), reversed(self._history[1:]), strict=True):
            older[slots] = newer[slots]
        self._history[0][slots] = chosen(self._look(slots, self._runner.rows.take(slots)), self.limits).values

    def _look(self, slots: IntArray, rows: Rows) -> Observation:
        """What is seen in the `rows` [K] of `slots` [K]; the options that follow begin with the same."""
        seen = sound(self.world, rows)
        if self._seen is None:
            self._seen = Observation(seen.columns, np.zeros((len(self), seen.values.shape[1])))
        self._seen.values[slots] = seen.values
        return seen

    def _refuse_unknown(self, slots: IntArray, actions: IntArray) -> None:
        named = slots.dtype.kind == "i" and slots.ndim == 1 and slots.shape == actions.shape
        if not named or ((slots < 0) | (slots >= len(self))).any() or len(np.unique(slots)) < len(slots):
            raise ConfigError(
                f"pool: slots must be different integers in [0, {len(self)}), one for each of {actions.size} actions, "
                f"got {slots.tolist()}"
            )

    def _refuse_busy(self, slots: IntArray) -> None:
        if not self.waiting[slots].all():
            raise ConfigError(f"pool: slots {slots[~self.waiting[slots]].tolist()} are busy; poll first")


def action_names(primitives: Sequence[Option], nominal: Sequence[Option]) -> tuple[str, ...]:
    """A names: the primitives, then each nominal option as the one that the chain goes on from."""
    return tuple([option.name for option in primitives] + [f"from {option.name}" for option in nominal])


def sound(world: World, rows: Rows) -> Observation:
    """The observation of the rows.

    Raises:
        ShapeError: NaN or infinity.
    """
    seen = world.observe(rows)
    if not np.isfinite(seen.values).all():
        bad = [name for name in seen.columns if not np.isfinite(seen[name]).all()]
        raise ShapeError(f"{world.name}: the observation holds NaN or infinity in {', '.join(bad)}")
    return seen


def chosen(seen: Observation, limits: Limits) -> Observation:
    """The fields that `limits` names, or all.

    Raises:
        ShapeError: no such field.
    """
    return Observation.of({name: seen[name] for name in limits.fields}) if limits.fields else seen


def first_state(world: World, rows: Rows, limits: Limits) -> Observation:
    """The state [N, O] at the start of an episode: there is nothing to remember, so the observation repeats."""
    return Observation.stack([chosen(sound(world, rows), limits)] * limits.history)

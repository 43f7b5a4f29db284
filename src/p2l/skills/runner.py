"""Many executions at once, each at its own option and its own step: nobody waits for anybody.

The runner has slots. A slot holds one row, the option that drives it and that option's memory; one call to `advance`
carries every busy slot through one control step in a single batch of the world, and tells which slots need a new
decision. What comes next is the caller's: a chain of nominal options, a recovery, a primitive action, or another
episode in the same slot. A world whose simulators go on by themselves may bring a runner of its own (`SelfRunning`).

Axis letters: B slots, K events.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from p2l.contracts.observation import Observation
from p2l.contracts.option import Option, reads_observation
from p2l.contracts.rows import Command, Rows
from p2l.contracts.world import NO_FAILURE, World
from p2l.errors import ConfigError
from p2l.records import BoolArray, IntArray

_STATE = ("busy", "option", "step", "steps_total", "path_m", "kind", "kind_step", "muted", "_memory")


class Reason(IntEnum):
    """Why a slot needs a decision."""

    TERMINATION = 0  # the option says it is done
    TIMEOUT = 1  # it has run for its maximal number of control steps
    FAILURE = 2  # a failure detector fired
    DIVERGENCE = 3  # the simulation of this row broke down


@dataclass(frozen=True)
class Events:
    """What happened during one control step.

    Attributes:
        slot: [K] which slots, ascending.
        reason: [K] values of `Reason`.
        kind: [K] kind of failure, `NO_FAILURE` where none.
    """

    slot: IntArray
    reason: IntArray
    kind: IntArray


class Runner:
    """Slots of executions that share an engine.

    Args:
        world: where they happen.
        options: what may drive a slot; an option is named by its index here.
        slots: B; from 32 on the engine's threads are busy.
        stop_on_failure: whether a detector's first flag ends the option (thesis, section 5.3.1) or is only noted.
    """

    def __init__(self, world: World, options: Sequence[Option], slots: int, *, stop_on_failure: bool = True) -> None:
        if slots < 1 or not options:
            raise ConfigError(f"runner: needs a slot and an option, got {slots} slots and {len(options)} options")
        self.world, self.options, self.stop_on_failure = world, tuple(options), stop_on_failure
        self.busy = np.zeros(slots, dtype=np.bool_)
        self.option = np.zeros(slots, dtype=np.int64)
        self.step = np.zeros(slots, dtype=np.int64)
        self.steps_total = np.zeros(slots, dtype=np.int64)
        self.path_m = np.zeros(slots)
        self.kind = np.full(slots, NO_FAILURE, dtype=np.int64)
        self.kind_step = np.zeros(slots, dtype=np.int64)
        self.muted = np.zeros(slots, dtype=np.bool_)
        self._memory = np.zeros((slots, max(option.memory_size for option in self.options)))
        alike = [getattr(option, "decides_as", index) for index, option in enumerate(self.options)]
        self._group = np.array([alike.index(name) for name in alike])  # options whose decisions are taken together
        self._reads = np.array([reads_observation(option) for option in self.options])
        self._limits = np.array([option.max_steps for option in self.options], dtype=np.int64)
        self._rows: Rows | None = None
        self._width = sum(where.stop - where.start for where in world.command_columns.values())

    @property
    def rows(self) -> Rows:
        """The rows of all slots; a slot that was never filled holds a copy of the first row given."""
        if self._rows is None:
            raise ConfigError("runner: no slot has been filled; call start first")
        return self._rows

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Everything that decides its future, for a checkpoint."""
        rows = {} if self._rows is None else {f"rows.{name}": value for name, value in self._rows.arrays().items()}
        return {**{name: getattr(self, name) for name in _STATE}, **rows}

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """From what `state` gave, of a runner of the same world, options and slots."""
        for name in _STATE:
            getattr(self, name)[:] = state[name]
        rows = {name.removeprefix("rows."): value for name, value in state.items() if name.startswith("rows.")}
        self._rows = Rows.from_arrays(rows) if rows else None

    def start(self, slots: IntArray, rows: Rows, option: IntArray) -> None:
        """A new episode in each of `slots` [K], from `rows` [K] with `option` [K]; counters start at 0."""
        self.place(slots, rows)
        self.begin(slots, option)

    def place(self, slots: IntArray, rows: Rows, muted: npt.ArrayLike = False) -> None:
        """A new episode in each of `slots` [K], which waits for `begin`; counters start at 0.

        Args:
            slots: [K].
            rows: [K] where the episodes start.
            muted: (of each) the start is a failure whose flag is still up (the hand still presses on the wall it hit):
                flags count from the first control step on that raises none.
        """
        if self._rows is None:
            self._rows = rows.take(np.zeros(len(self.busy), dtype=np.int64))
        self.rows.put(slots, rows)
        self.busy[slots] = False
        self.steps_total[slots] = 0
        self.path_m[slots] = 0.0
        self.muted[slots] = muted

    def begin(self, slots: IntArray, option: IntArray, observation: Observation | None = None) -> None:
        """The next `option` [K] of the episodes in `slots` [K]; forgets the flags of the option before.

        Args:
            slots: [K].
            option: [K] what drives them.
            observation: [K] of their rows, if it is there already.
        """
        self.busy[slots] = True
        self.option[slots] = option
        self.step[slots] = 0
        self.kind[slots] = NO_FAILURE
        if observation is None:
            observation = self.world.observe(self.rows.take(slots))
        for index in np.unique(option):
            where = np.flatnonzero(option == index)
            memory = self.options[index].begin(observation.take(where))
            self._memory[slots[where], : memory.shape[1]] = memory

    def stop(self, slots: IntArray) -> None:
        """Free `slots` [K]."""
        self.busy[slots] = False

    def advance(self, *, by_step: bool = False) -> Events:  # noqa: ARG002
        """Let busy slots go on; the slots of the events returned wait for `begin`, `start` or `stop`.

        Args:
            by_step: one control step of every busy slot, as it is here in any case.
        """
        live = np.flatnonzero(self.busy)
        command, done = self._decide(live)
        late = ~done & (self.step[live] >= self._limits[self.option[live]])
        reason = np.full(len(live), -1, dtype=np.int64)
        reason[done], reason[late] = Reason.TERMINATION, Reason.TIMEOUT
        moving = np.flatnonzero(~(done | late))
        if len(moving):
            reason[moving] = self._move(live[moving], command.take(moving))
        stops = np.flatnonzero(reason >= 0)
        slots = live[stops]
        self.busy[slots] = False
        self.rows.actions[slots] += 1
        return Events(slots, reason[stops], self.kind[slots].copy())

    def _decide(self, live: IntArray) -> tuple[Command, BoolArray]:
        group = self._group[self.option[live]]
        reading = np.flatnonzero(self._reads[group])  # of the others nothing is observed: it costs as much as all else
        seen = self.world.observe(self.rows.take(live[reading])) if len(reading) else None
        values = np.empty((len(live), self._width))
        done = np.zeros(len(live), dtype=np.bool_)
        for index in np.unique(group):
            option = self.options[index]
            where = np.flatnonzero(group == index)
            slots, size = live[where], option.memory_size
            observation = Observation.unseen(len(where))
            if seen is not None and self._reads[index]:
                observation = seen.take(np.searchsorted(reading, where))
            decision = option.decide(observation, self._memory[slots, :size], self.step[slots])
            self._memory[slots, :size] = decision.memory
            values[where], done[where] = decision.command.values, decision.done
        return Command(self.world.command_columns, values), done

    def _move(self, slots: IntArray, command: Command) -> IntArray:
        """Carry `slots` through one control step; why each stops, or −1."""
        before = self.rows.take(slots)
        after, kind, diverged = self.world.advance(before, command)
        sound = np.flatnonzero(~diverged)
        # A diverged row keeps its last sound moment.
        self.rows.put(slots[sound], after if len(sound) == len(slots) else after.take(sound))
        self.step[slots] += 1
        self.steps_total[slots] += 1
        with np.errstate(invalid="ignore", over="ignore"):  # of diverged rows, whose way does not count
            self.path_m[slots[sound]] += self.world.path_m(before, after)[sound]
        flag = (kind != NO_FAILURE) & ~diverged
        first = flag & (self.kind[slots] == NO_FAILURE) & ~self.muted[slots]
        self.muted[slots] &= flag
        self.kind[slots[first]] = kind[first]
        self.kind_step[slots[first]] = self.steps_total[slots[first]]
        reason = np.full(len(slots), -1, dtype=np.int64)
        if self.stop_on_failure:
            reason[first] = Reason.FAILURE
        reason[diverged] = Reason.DIVERGENCE
        return reason


@runtime_checkable
class SelfRunning(Protocol):
    """A world that runs its options itself, without a copy of the state per control step."""

    def runner(self, options: Sequence[Option], slots: int, *, stop_on_failure: bool) -> Runner | None:
        """A runner of these options; None if some of them are not the world's own."""


def open_runner(world: World, options: Sequence[Option], slots: int, *, stop_on_failure: bool = True) -> Runner:
    """The world's own runner where it has one for these options, else one that steps its rows; see `Runner`."""
    own = world.runner(options, slots, stop_on_failure=stop_on_failure) if isinstance(world, SelfRunning) else None
    return own or Runner(world, options, slots, stop_on_failure=stop_on_failure)

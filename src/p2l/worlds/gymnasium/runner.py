"""A runner whose slots are rows of environments, each of which runs its option to the end in some process.

No state is copied while an option goes on: a row is taken when it ends, and put where the next one begins. Results are
handed over in the order in which their jobs began, a fixed number at a time, so that what happens does not depend on
which process was faster, nor on how many there are.
"""

from __future__ import annotations

import logging
import weakref
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from p2l.contracts.observation import Observation
from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import NO_FAILURE, World
from p2l.records import Array, IntArray
from p2l.skills.runner import Events, Reason, Runner
from p2l.worlds.gymnasium.jobs import GOES_ON, JobResult, Moment, OptionJob
from p2l.worlds.gymnasium.processes import Processes

log = logging.getLogger(__name__)

SHARE = 8  # one in so many slots is handed over at a time; the others keep the processes busy


class ProcessRunner(Runner):
    """See `skills.runner.Runner`; this one's slots do not go in step.

    Args:
        world: of environments.
        processes: of the world.
        error: [N, E] of the robot's estimate in rows [N].
        options: of the world, its controllers and primitives.
        places: [options] of each in the definition of the world.
        slots: B.
        stop_on_failure: whether a detector's first flag ends the option.
    """

    def __init__(
        self,
        world: World,
        processes: Processes,
        error: Callable[[Rows], Array],
        options: Sequence[Option],
        places: Sequence[int],
        slots: int,
        *,
        stop_on_failure: bool = True,
    ) -> None:
        super().__init__(world, options, slots, stop_on_failure=stop_on_failure)
        self._processes, self._places, self._error = processes, tuple(places), error
        self._lanes: list[int] = self._processes.take_lanes(slots).tolist()
        self._is_there = np.zeros(slots, dtype=np.bool_)  # the lane's last job has left the slot's row
        self._tickets: dict[int, int] = {}  # of the slots at work, in the order in which they began
        self._waiting: list[int] = []  # slots whose job has not been handed in yet
        weakref.finalize(self, self._processes.give_lanes, self._lanes)

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Everything that decides its future; jobs at work are begun anew."""
        return super().state() | {"order": np.array([*self._tickets, *self._waiting], dtype=np.int64)}

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """From what `state` gave."""
        self._drop(np.arange(len(self.busy)))
        super().restore(state)
        self._waiting = state["order"].tolist()

    def place(self, slots: IntArray, rows: Rows, muted: npt.ArrayLike = False) -> None:
        """See `Runner.place`."""
        self._drop(slots)
        super().place(slots, rows, muted)

    def begin(self, slots: IntArray, option: IntArray, observation: Observation | None = None) -> None:  # noqa: ARG002
        """See `Runner.begin`."""
        self.busy[slots] = True
        self.option[slots], self.step[slots], self.kind[slots], self._memory[slots] = option, 0, NO_FAILURE, 0.0
        self._waiting += np.asarray(slots).tolist()

    def stop(self, slots: IntArray) -> None:
        """See `Runner.stop`."""
        self._drop(slots)
        super().stop(slots)

    def advance(self, *, by_step: bool = False) -> Events:
        """Wait for the slots that have been at work longest.

        Args:
            by_step: one control step of every busy slot.
        """
        for slot in self._waiting:
            self._hand_in(slot, most=int(by_step))
        self._waiting.clear()
        count = len(self._tickets) if by_step else max(1, len(self.busy) // SHARE)
        reasons: dict[int, int] = {}
        for slot in list(self._tickets)[:count]:
            outcome: JobResult = self._processes.collect(self._tickets.pop(slot))
            self._finish(slot, outcome)
            if outcome.reason == GOES_ON:
                self._waiting.append(slot)
            else:
                reasons[slot] = outcome.reason
        slots = np.array(sorted(reasons), dtype=np.int64)
        self.busy[slots] = False
        self.rows.actions[slots] += 1
        reason = np.array([reasons[slot] for slot in slots.tolist()], dtype=np.int64)
        return Events(slots, reason, self.kind[slots].copy())

    def _hand_in(self, slot: int, most: int) -> None:
        option = int(self.option[slot])
        row = self.rows.window(slot)
        job = OptionJob(
            option=self._places[option],
            step=int(self.step[slot]),
            memory=self._memory[slot, : self.options[option].memory_size].copy(),
            error=self._error(row)[0],
            kind=int(self.kind[slot]),
            muted=bool(self.muted[slot]),
            stop_on_failure=self.stop_on_failure,
            most=most,
        )
        moment = None if self._is_there[slot] else Moment(memoryview(row.states[0]), row.sensors[0])
        self._tickets[slot] = self._processes.submit(self._lanes[slot], "run", job, moment)

    def _finish(self, slot: int, outcome: JobResult) -> None:
        self._is_there[slot] = outcome.reason != Reason.DIVERGENCE
        if self._is_there[slot]:  # a diverged row keeps its last sound moment
            state, sensed = self._processes.row(self._lanes[slot])
            self.rows.states[slot], self.rows.sensors[slot] = state, sensed
        elif outcome.told:
            log.warning("world '%s': a row diverged: %s", self.world.name, outcome.told)
        self._memory[slot, : len(outcome.memory)] = outcome.memory
        if outcome.kind_step:
            self.kind[slot] = outcome.kind
            self.kind_step[slot] = self.steps_total[slot] + outcome.kind_step
        self.muted[slot] = outcome.muted
        self.step[slot] += outcome.steps
        self.steps_total[slot] += outcome.steps
        self.path_m[slot] += outcome.path

    def _drop(self, slots: IntArray) -> None:
        """Forget what these slots are doing."""
        self._is_there[slots] = False
        for slot in np.asarray(slots).tolist():
            if slot in self._tickets:
                self._processes.collect(self._tickets.pop(slot))
        gone = set(np.asarray(slots).tolist())
        self._waiting = [slot for slot in self._waiting if slot not in gone]

"""Closed-loop options: a state machine that picks a target pose from what is observed, at every control step.

Thesis, section 5.4.1, "Nominal Skills": "Each controller is implemented as a state machine that selects a target pose
for the robot end-effector in the Cartesian space based on its current state. The target end-effector pose is then
achieved using task-space impedance control with fixed impedance."

The impedance target runs ahead of the arm at a bounded pace towards the goal of the present phase; the goal is computed
anew at every control step. A row remembers its phase, how long it has been in it, how far the fingers were open
before, and the orientation that was chosen at the start. Nothing of the way so far counts, so an option may start from
any state: `enter` says which phase fits what is observed. Machines of one `group` decide in one batch.

Axis letters: N rows, P phases of all machines of a group.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from p2l import poses
from p2l.contracts.observation import Observation, Privileged
from p2l.contracts.option import OptionStep
from p2l.contracts.rows import Command
from p2l.records import Array, BoolArray, IntArray

_PHASE, _STEPS, _GAP, _QUAT, _END = 0, 1, 2, slice(3, 7), 7
MEMORY = 8


@dataclass(frozen=True)
class Phase:
    """One state of the machine.

    Attributes:
        goal: [N, 3] where the grip site should go, m, from the observation.
        grip: command for the fingers, 0 = open, 1 = closed.
        limit: control steps after which the next phase begins whatever has been reached.
        pace_m: the target moves at most so far in a control step, m.
        reached_m: the phase is over once the grip site is this close to its goal, m,
        reached_rad: and to the orientation to hold; infinite: no matter.
        still_m: the phase is over only when the opening between the fingers changes by less than this in a control
            step, m; infinite: the fingers are no matter.
        open_m: the phase is over only when the fingers are at least so far apart, m.
        at_least: control steps that the phase lasts whatever is observed.
    """

    goal: Callable[[Observation], Array]
    grip: float
    limit: int = 15
    pace_m: float = 0.05
    reached_m: float = 0.01
    reached_rad: float = 0.2
    still_m: float = np.inf
    open_m: float = 0.0
    at_least: int = 0


@dataclass(frozen=True)
class Machine:
    """An option made of phases.

    Attributes:
        name: of the option.
        phases: P phases, passed through in order.
        orient: [N, 4] the orientation to hold, chosen once at the start.
        ready: the hand-written precondition.
        enter: [N] phase to begin with; the first without it.
        pace_rad: the target turns at most so far in a control step.
        group: phases of all machines that decide in one batch with this one; its own alone without any.
        first: place of its own first phase among them.
    """

    name: str
    phases: tuple[Phase, ...]
    orient: Callable[[Observation], Array]
    ready: Callable[[Privileged], BoolArray]
    enter: Callable[[Observation], IntArray] | None = None
    pace_rad: float = 0.25
    group: tuple[Phase, ...] = ()
    first: int = 0

    @property
    def decides_as(self) -> tuple[tuple[Phase, ...], float]:
        """What its decisions depend on, apart from its memory."""
        return self._all, self.pace_rad

    @property
    def memory_size(self) -> int:
        """Phase, steps in it, opening of the fingers before, orientation, the phase that is not its own any more."""
        return MEMORY

    @property
    def max_steps(self) -> int:
        """The sum of the phases' limits."""
        return sum(phase.limit for phase in self.phases)

    def precondition(self, truth: Privileged) -> BoolArray:
        """As written by hand."""
        return self.ready(truth)

    def begin(self, observation: Observation) -> Array:
        """The phase that fits, and the orientation to hold."""
        memory = np.zeros((len(observation), MEMORY))
        memory[:, _PHASE] = self.first + (0 if self.enter is None else self.enter(observation))
        memory[:, _GAP] = np.inf
        memory[:, _QUAT] = self.orient(observation)
        memory[:, _END] = self.first + len(self.phases)
        return memory

    def decide(self, observation: Observation, memory: Array, step: IntArray) -> OptionStep:
        """Change phase where the present one is over, then move the target on."""
        del step  # a machine counts in its phases
        memory = memory.copy()
        goals = np.zeros((len(self._all), len(observation), 3))
        for phase in _near(memory):
            goals[phase] = self._all[phase].goal(observation)
        gap = observation["gap_m"][:, 0]
        over = self._over(observation, goals, memory, np.abs(gap - memory[:, _GAP]))
        memory[over, _PHASE] += 1
        memory[over, _STEPS] = 0
        memory[:, _STEPS] += 1
        memory[:, _GAP] = gap
        done, index = memory[:, _PHASE] >= memory[:, _END], _present(memory)
        goal = goals[index, np.arange(len(observation))]
        pos = _towards(observation["target_pos_m"], goal, self._of["pace_m"][index])
        quat = _turn(observation["target_quat"], memory[:, _QUAT], self.pace_rad)
        return OptionStep(Command.pose(pos, quat, self._of["grip"][index]), memory, done)

    def _over(self, observation: Observation, goals: Array, memory: Array, change_m: Array) -> BoolArray:
        index, steps, of = _present(memory), memory[:, _STEPS], self._of
        goal = goals[index, np.arange(len(observation))]
        away = np.linalg.norm(observation["grip_pos_m"] - goal, axis=1)
        turn = poses.angle(observation["grip_quat"], memory[:, _QUAT])
        there = (away < of["reached_m"][index]) & (turn < of["reached_rad"][index])
        fingers = (change_m <= of["still_m"][index]) & (observation["gap_m"][:, 0] >= of["open_m"][index])
        return np.asarray((there & fingers & (steps >= of["at_least"][index])) | (steps >= of["limit"][index]))

    @cached_property
    def _all(self) -> tuple[Phase, ...]:
        return self.group or self.phases

    @cached_property
    def _of(self) -> dict[str, Array]:
        """[P] attributes of the phases that are numbers."""
        names = [field.name for field in fields(Phase) if field.name != "goal"]
        return {name: np.array([getattr(phase, name) for phase in self._all], dtype=np.float64) for name in names}


def link(machines: Sequence[Machine]) -> tuple[Machine, ...]:
    """The same machines as one group: those that are equally fast decide in one batch."""
    phases = tuple(phase for machine in machines for phase in machine.phases)
    firsts = np.cumsum([0, *(len(machine.phases) for machine in machines)]).tolist()
    return tuple(replace(one, group=phases, first=first) for one, first in zip(machines, firsts, strict=False))


def _present(memory: Array) -> IntArray:
    """[N] the phase; the last one of a machine that is done."""
    return np.minimum(memory[:, _PHASE], memory[:, _END] - 1).astype(np.int64)


def _near(memory: Array) -> list[int]:
    """The phases that some row is in, or will be in after this control step."""
    present, last = _present(memory), memory[:, _END].astype(np.int64) - 1
    return sorted({*present.tolist(), *np.minimum(present + 1, last).tolist()})


def _towards(start: Array, goal: Array, pace: Array) -> Array:
    """[N, 3] on the straight way from `start` to `goal`, at most `pace` [N] along it."""
    way = goal - start
    length = np.linalg.norm(way, axis=1)
    return np.asarray(start + way * np.minimum(1.0, pace / np.maximum(length, 1e-12))[:, None])


def _turn(start: Array, goal: Array, pace_rad: float) -> Array:
    """[N, 4] on the shorter way from `start` to `goal`, at most `pace_rad` along it."""
    angle = poses.angle(start, goal)
    return poses.between(start, goal, np.minimum(1.0, pace_rad / np.maximum(angle, 1e-12)))

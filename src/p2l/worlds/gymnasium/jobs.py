"""What a process is asked for a row of an environment, and what it answers.

Axis letters: D numbers of an observation, A of an action, E of the error of the robot's estimate, m of a memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from p2l.records import Array

GOES_ON = -1


@dataclass(frozen=True)
class Moment:
    """A row of an environment: its packed state, and [D + A + 2] what was sensed last."""

    state: bytes | memoryview
    sensed: Array


@dataclass(frozen=True)
class OptionJob:
    """An option to run for one row.

    Attributes:
        option: its place in `Definition.options`.
        step: control steps since it began.
        memory: [m].
        error: [E] of the robot's estimate.
        kind: flag that was up before, or `NO_FAILURE`.
        muted: flags do not count before one step raised none.
        stop_on_failure: a flag ends the option.
        most: control steps, at most; 0 as many as it takes.
        command: [A] carried out for one step, instead of an option; None for an option.
    """

    option: int
    step: int
    memory: Array
    error: Array
    kind: int
    muted: bool
    stop_on_failure: bool
    most: int
    command: Array | None = None

    def to_plain(self) -> tuple[Any, ...]:
        """For a message, without arrays, which take long to send."""
        command = None if self.command is None else self.command.tolist()
        numbers = self.memory.tolist(), self.error.tolist()
        return (self.option, self.step, *numbers, self.kind, self.muted, self.stop_on_failure, self.most, command)

    @classmethod
    def of_plain(cls, plain: tuple[Any, ...]) -> OptionJob:
        """From what `to_plain` gave."""
        option, step, memory, error, kind, muted, stop, most, command = plain
        given = None if command is None else _array(command)
        return cls(option, step, _array(memory), _array(error), kind, muted, stop, most, given)


@dataclass(frozen=True)
class JobResult:
    """How a job ended.

    Attributes:
        reason: a value of `runner.Reason`, or `GOES_ON`.
        steps: control steps of the job.
        memory: [m].
        kind: flag, or `NO_FAILURE`.
        kind_step: control step of the job at which it was raised, 0 if before it.
        muted: as in the job.
        path: way of `position`, in its unit.
        told: what went wrong in the environment, if it diverged.
    """

    reason: int
    steps: int
    memory: Array
    kind: int
    kind_step: int
    muted: bool
    path: float
    told: str = ""

    def to_plain(self) -> tuple[Any, ...]:
        """For a message."""
        rest = self.kind, self.kind_step, self.muted, self.path, self.told
        return (int(self.reason), self.steps, self.memory.tolist(), *rest)

    @classmethod
    def of_plain(cls, plain: tuple[Any, ...]) -> JobResult:
        """From what `to_plain` gave."""
        reason, steps, memory, *rest = plain
        return cls(reason, steps, _array(memory), *rest)


def _array(numbers: Sequence[float]) -> Array:
    return np.array(numbers, dtype=np.float64)

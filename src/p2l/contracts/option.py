"""The contract of a nominal skill: an option with a precondition, a policy and a termination.

An option decides at every control step, for all rows that run it at once; what it must remember of a row lives in
that row's memory, so rows come and go in any order. Options that differ only in what they put there may say so by
equal attributes `decides_as`, and then decide in one batch. One whose decisions follow from its memory alone marks its
`decide` by `from_memory`, and nothing is observed for them. An option acts on observations only; its hand-written
precondition is judged on the truth (thesis, section 4.3.1: "not able to recover from it even if it could observe the
true state").

Axis letters: N rows, m columns of an option's memory.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar, runtime_checkable

from p2l.contracts.observation import Observation, Privileged
from p2l.contracts.rows import Command
from p2l.records import Array, BoolArray, IntArray

_Decide = TypeVar("_Decide", bound=Callable[..., "OptionStep"])


@dataclass(frozen=True)
class OptionStep:
    """What an option wants for the next control step.

    Attributes:
        command: the target pose and grip.
        memory: [N, m] what it will remember.
        done: [N] it has ended, and the command is not carried out.
    """

    command: Command
    memory: Array
    done: BoolArray


@runtime_checkable
class Option(Protocol):
    """One nominal skill."""

    @property
    def name(self) -> str:
        """For tables and files, e.g. `pull_handle`."""

    @property
    def memory_size(self) -> int:
        """Columns of memory that a row needs."""

    @property
    def max_steps(self) -> int:
        """Control steps after which it is ended whatever it wants."""

    def precondition(self, truth: Privileged) -> BoolArray:
        """[N] hand-written initiation set."""

    def begin(self, observation: Observation) -> Array:
        """[N, m] memory at the start, from what is observed then."""

    def decide(self, observation: Observation, memory: Array, step: IntArray) -> OptionStep:
        """The next control step; `step` [N] counts those carried out since `begin`."""


def from_memory(decide: _Decide) -> _Decide:
    """Mark an option's `decide` that reads memory and step alone: its observation has rows, and no fields.

    The mark is the function's, not the class's: a subclass that decides anew is observed for again.
    """
    decide.from_memory = True  # type: ignore[attr-defined]
    return decide


def reads_observation(option: Option) -> bool:
    """Whether the option's decisions need an observation; they do unless it says otherwise."""
    return not getattr(option.decide, "from_memory", False)

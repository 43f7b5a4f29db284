"""What an environment's robot can do: controllers that a person has written, and held actions as primitives.

Axis letters: N rows, A numbers of an action, m columns of a controller's memory.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from p2l.contracts.observation import Observation, Privileged
from p2l.contracts.option import OptionStep
from p2l.contracts.rows import Command
from p2l.errors import ConfigError
from p2l.records import Array, BoolArray, IntArray
from p2l.worlds.gymnasium.layout import Layout

Act = Callable[[Any, Array], tuple[Any, Any, bool]]
ACTION = "action"


@dataclass(frozen=True)
class Controller:
    """A nominal skill.

    Attributes:
        name: for tables and files, e.g. `reach`.
        act: from an observation as the environment gives it (with the robot's errors) and the memory [m] to the action,
            the new memory and whether the skill has ended; once it has, the action is not carried out.
        max_steps: control steps after which it is ended whatever it wants.
        memory_size: m numbers that it remembers while it runs; zeros at its start.
        precondition: whether it can start at an observation (the truth); everywhere without it.
    """

    name: str
    act: Act
    max_steps: int
    memory_size: int = 0
    precondition: Callable[[Any], bool] | None = None


@dataclass(frozen=True)
class HeldAction:
    """A primitive: one action, held for some control steps.

    Attributes:
        name: e.g. `+x`.
        action: [A]; NaN where the last action goes on (a gripper that keeps its command).
        steps: how long.
    """

    name: str
    action: Sequence[float]
    steps: int

    @property
    def max_steps(self) -> int:
        """Its own length."""
        return self.steps

    memory_size = 0


def box_primitives(
    size: float | Sequence[float], steps: int, names: Sequence[str], *, keep: Sequence[str] = ()
) -> tuple[HeldAction, ...]:
    """A held action to either side along each dimension of a Box.

    Args:
        size: of an action, in the Box's unit; a number, or one for each dimension.
        steps: control steps that each is held.
        names: of the dimensions, in order.
        keep: dimensions that no primitive moves, and that keep the last command.

    Example:
        >>> from p2l.worlds.gymnasium import box_primitives
        >>> [primitive.name for primitive in box_primitives(0.5, 5, ["x", "y", "grip"], keep=["grip"])]
        ['+x', '-x', '+y', '-y']
    """
    if unknown := sorted(set(keep) - set(names)):
        raise ConfigError(f"box_primitives: there is no dimension {', '.join(unknown)} among {', '.join(names)}")
    sizes = np.broadcast_to(np.asarray(size, dtype=np.float64), (len(names),))
    still = np.array([np.nan if name in keep else 0.0 for name in names])
    made = []
    for axis, name in enumerate(names):
        for sign in (1.0, -1.0):
            if name not in keep:
                action = still.copy()
                action[axis] = sign * sizes[axis]
                made.append(HeldAction(f"{'+' if sign > 0 else '-'}{name}", tuple(action.tolist()), steps))
    return tuple(made)


def to_numbers(action: Any, layout: Layout, name: str | None = None) -> Array:
    """[A] of an action of a controller, or of a command without a name.

    Raises:
        ConfigError: of another shape, or no finite number.
    """
    try:
        values = np.asarray(action, dtype=np.float64)
    except (TypeError, ValueError):
        raise ConfigError(f"{_who(name)}: its action is a {type(action).__name__}, not {_wanted(layout)}") from None
    if values.shape != layout.action:
        raise ConfigError(f"{_who(name)}: its action has shape {values.shape}, not {_wanted(layout)}")
    flat = values if values.ndim == 1 else values.reshape(-1)
    numbers = flat.tolist()  # the sum of finite ones is finite, and faster to tell than that all of them are
    if not math.isfinite(sum(numbers)) and not all(map(math.isfinite, numbers)):
        raise ConfigError(f"{_who(name)}: its action holds NaN or infinity")
    if layout.actions and not 0 <= int(values) < layout.actions:
        raise ConfigError(f"{_who(name)}: there is no action {int(values)} among {layout.actions}")
    return flat


def _who(name: str | None) -> str:
    return "command" if name is None else f"controller '{name}'"


def _wanted(layout: Layout) -> str:
    return f"one of {layout.actions} actions" if layout.actions else f"the environment's {layout.action}"


def decide(
    option: Controller | HeldAction, layout: Layout, seen: Any, last: Array, memory: Array, step: int
) -> tuple[Array, Array, bool]:
    """The action [A], the memory [m] and whether the option has ended, for one row.

    Args:
        option: what drives it.
        layout: of the environment.
        seen: the observation as the environment would give it.
        last: [A] the action before.
        memory: [m] of the option.
        step: control steps since it began.

    Raises:
        ConfigError: an action or a memory of another shape; an error inside a controller.
    """
    if isinstance(option, HeldAction):
        action = np.asarray(option.action, dtype=np.float64)
        return np.where(np.isnan(action), last, action), memory, step >= option.steps
    wanted, kept, done = ask(option, layout, seen, memory)
    return last if wanted is None else wanted, kept, done


def ask(option: Controller, layout: Layout, seen: Any, memory: Array) -> tuple[Array | None, Array, bool]:
    """What a controller answers: the action [A], None if it has ended, the memory [m] and whether it has ended.

    Raises:
        ConfigError: as `decide`.
    """
    try:
        answer = option.act(seen, memory.copy())
    except Exception as error:
        raise ConfigError(f"{_who(option.name)}: {type(error).__name__}: {error}{_where(error)}") from error
    if not isinstance(answer, tuple) or len(answer) != 3:
        raise ConfigError(
            f"{_who(option.name)}: `act` must return action, memory, done; it returned {type(answer).__name__}"
        )
    action, remembered, done = answer
    kept = np.zeros(0) if remembered is None else np.asarray(remembered, dtype=np.float64)
    kept = kept if kept.ndim == 1 else kept.reshape(-1)
    if kept.shape != (option.memory_size,):
        told = f"its memory has {kept.size} numbers; memory_size says {option.memory_size}"
        raise ConfigError(f"{_who(option.name)}: {told}")
    if done:
        return None, kept, True
    return to_numbers(action, layout, option.name), kept, False


def _where(error: BaseException) -> str:
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return "" if trace is None else f" ({trace.tb_frame.f_code.co_filename}, line {trace.tb_lineno})"


@dataclass(frozen=True)
class BoundOption:
    """A controller or a primitive as the contract knows options, for whoever steps rows in this process.

    Attributes:
        option: what a person has given.
        layout: of the environment.
        fields: columns of the flat observation, by name in the world's observation.
    """

    option: Controller | HeldAction
    layout: Layout
    fields: dict[str, slice]

    @property
    def name(self) -> str:
        """As given."""
        return self.option.name

    @property
    def memory_size(self) -> int:
        """As given."""
        return self.option.memory_size

    @property
    def max_steps(self) -> int:
        """As given."""
        return self.option.max_steps

    def precondition(self, truth: Privileged) -> BoolArray:
        """As written by hand; everywhere without it."""
        ready = self.option.precondition if isinstance(self.option, Controller) else None
        if ready is None:
            return np.ones(len(truth), dtype=np.bool_)
        return np.array([bool(ready(self.layout.structure(flat))) for flat in self._flat(truth)], dtype=np.bool_)

    def begin(self, observation: Observation) -> Array:
        """Zeros."""
        return np.zeros((len(observation), self.memory_size))

    def decide(self, observation: Observation, memory: Array, step: IntArray) -> OptionStep:
        """Row by row, as a person's function wants it; worlds of environments do it in their processes."""
        flat, last = self._flat(observation), observation["last_action"]
        answers = [
            decide(self.option, self.layout, self.layout.structure(flat[row]), last[row], memory[row], int(step[row]))
            for row in range(len(flat))
        ]
        actions, memories, done = zip(*answers, strict=True) if answers else ((), (), ())
        values = np.reshape(np.array(actions), (len(flat), self.layout.action_size))
        command = Command({ACTION: slice(0, self.layout.action_size)}, values)
        return OptionStep(command, np.reshape(np.array(memories), memory.shape), np.array(done, dtype=np.bool_))

    def _flat(self, source: Observation | Privileged) -> Array:
        flat = np.empty((len(source), self.layout.size))
        for name, where in self.fields.items():
            flat[:, where] = source[name]
        return flat


def checked_options(
    controllers: Sequence[Controller], primitives: Sequence[HeldAction], layout: Layout, space: Any
) -> None:
    """Refuse controllers and primitives that this environment cannot run.

    Raises:
        ConfigError: no controller, a name twice, a bound below 1, a primitive of another shape or outside the Box.
    """
    every: list[Controller | HeldAction] = [*controllers, *primitives]
    names = [option.name for option in every]
    if not controllers:
        raise ConfigError("give at least one controller: the nominal skills, in order")
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ConfigError(f"two controllers or primitives are called {', '.join(twice)}")
    for option in every:
        if option.max_steps < 1:
            raise ConfigError(f"'{option.name}': its bound is {option.max_steps} control steps; it must be at least 1")
    for primitive in primitives:
        values = np.asarray(primitive.action, dtype=np.float64)
        if values.size != layout.action_size:
            raise ConfigError(
                f"primitive '{primitive.name}': has {values.size} numbers, an action {layout.action_size}"
            )
        if isinstance(space, gymnasium.spaces.Box):
            low, high, given = space.low.reshape(-1), space.high.reshape(-1), ~np.isnan(values)
            if ((values < low - 1e-6) | (values > high + 1e-6))[given].any():
                raise ConfigError(f"primitive '{primitive.name}': {values.tolist()} lies outside the Box of actions")

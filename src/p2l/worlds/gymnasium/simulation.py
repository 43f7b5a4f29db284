"""One environment, and what may be asked of it: reset, go on from a kept state, run an option to its end.

It works in a process of its own (`worker`); nothing here knows of that. A row of an environment is its packed state and
what was sensed last: the observation, the last action, whether the task is done and whether the environment has ended
(1 terminated, 2 truncated).

Axis letters: D numbers of an observation, A of an action, E of the error of the robot's estimate, m of a memory.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from p2l.contracts.world import NO_FAILURE
from p2l.errors import ConfigError, ShapeError
from p2l.records import Array
from p2l.skills.runner import Reason
from p2l.worlds.gymnasium.jobs import GOES_ON, JobResult, Moment, OptionJob
from p2l.worlds.gymnasium.layout import Layout, Noise, NoiseMap
from p2l.worlds.gymnasium.options import Controller, HeldAction, ask, checked_options, decide, to_numbers
from p2l.worlds.gymnasium.physics import MujocoState
from p2l.worlds.gymnasium.snapshot import pack, unpack

ENDS = ("terminated", "truncated")  # the environment's own ends, where the task is not done
_FIRST_SEED = 0  # of the reset that makes every process's model the same


@dataclass(frozen=True)
class Definition:
    """What a person says of an environment; see `world.GymnasiumWorld`."""

    make_env: Callable[[], Any]
    controllers: tuple[Controller, ...]
    primitives: tuple[HeldAction, ...]
    success: Callable[[Any, Any], bool]
    failed: Callable[[Any, Any], Any]
    failures: tuple[str, ...]
    noise: tuple[Noise, ...]
    position: str | None
    get_state: Callable[[Any], Mapping[str, Any]] | None
    set_state: Callable[[Any, Mapping[str, Any]], None] | None
    draw: Callable[[Any], Any] | None

    @property
    def options(self) -> tuple[Controller | HeldAction, ...]:
        """Primitives, then controllers; a job names one by its place."""
        return (*self.primitives, *self.controllers)


class Simulation:
    """One environment in the hands of p2l.

    Args:
        definition: of the world.

    Raises:
        ConfigError: it cannot be made, or is not one that p2l can drive.
    """

    def __init__(self, definition: Definition) -> None:
        self.definition = definition
        try:
            self.env = definition.make_env()
            observation, _ = self.env.reset(seed=_FIRST_SEED)
        except Exception as error:
            raise ConfigError(f"make_env: {type(error).__name__}: {error}") from error
        self.layout = Layout.of(observation, self.env.action_space)
        checked_options(definition.controllers, definition.primitives, self.layout, self.env.action_space)
        self.noise = NoiseMap.of(self.layout, definition.noise)
        self._position = None if definition.position is None else self.layout.place(definition.position)
        self._is_flat = self.layout.is_flat
        self._kinds = {name: place for place, name in enumerate(definition.failures)}
        self._mujoco = None if definition.get_state else MujocoState(self.env)
        self._sensed, self._is_done, self._is_over = np.zeros(0), False, False
        self.copies = 0  # of a whole state, taken or put
        self._sense(observation, None, np.zeros(self.layout.action_size))
        self._first = self.take()

    def reset(self, seed: int) -> None:
        """A new episode, the same whatever the environment has done before.

        Raises:
            ConfigError: its observation holds NaN.
        """
        self.put(self._first)
        observation, _ = self.env.reset(seed=seed)
        self._sense(observation, None, np.zeros(self.layout.action_size))
        if not np.isfinite(self._sensed).all():
            raise ConfigError(f"after reset(seed={seed}) the observation holds NaN or infinity{self._bad()}")

    def take(self) -> Moment:
        """The present row."""
        self.copies += 1
        return Moment(pack(self.fields()), self._sensed.copy())

    def fields(self) -> Mapping[str, Any]:
        """Fields of the present state."""
        if self._mujoco is not None:
            return self._mujoco.get(self.env)
        assert self.definition.get_state is not None
        return self.definition.get_state(self.env)

    def put(self, moment: Moment) -> None:
        """Go back to a row."""
        self.copies += 1
        fields = unpack(moment.state)
        if self._mujoco is not None:
            self._mujoco.set(self.env, fields)
        elif self.definition.set_state is not None:
            self.definition.set_state(self.env, fields)
        else:
            raise ConfigError("a world with `get_state` needs `set_state`, too")
        self._sensed = moment.sensed.copy()
        self._is_done, self._is_over = bool(self._sensed[-2] > 0.5), bool(self._sensed[-1] > 0.5)

    def run(self, job: OptionJob) -> JobResult:
        """Let an option go on from the present row."""
        memory, kind, kind_step, muted, path, steps = job.memory, job.kind, 0, job.muted, 0.0, 0
        option, seen = self.definition.options[job.option], None
        action: Array | None
        shift = self.noise.shift(job.error, self.layout.size)
        if job.command is not None and self._is_over:  # the environment has ended: it stays where it is
            end = NO_FAILURE if self._is_done else self._kinds[ENDS[int(self._sensed[-1]) - 1]]
            return JobResult(GOES_ON, 0, memory, end, kind_step, muted, path)
        while True:
            if job.command is None:
                if self._is_over:  # the environment has ended with the task done
                    return JobResult(Reason.TERMINATION, steps, memory, kind, kind_step, muted, path)
                obs = self._seen(shift) if seen is None else seen
                if isinstance(option, HeldAction):
                    action, memory, done = decide(option, self.layout, obs, self.last_action, memory, job.step + steps)
                else:
                    action, memory, done = ask(option, self.layout, obs, memory)
                if done or action is None or job.step + steps >= option.max_steps:
                    reason = Reason.TERMINATION if done else Reason.TIMEOUT
                    return JobResult(reason, steps, memory, kind, kind_step, muted, path)
            else:
                action = to_numbers(job.command.reshape(self.layout.action), self.layout)
            before = self._sensed
            seen, found, told = self._step(action, shift, option.name, job.step + steps)
            steps += 1
            if told:
                return JobResult(Reason.DIVERGENCE, steps, memory, kind, kind_step, muted, path, told)
            if self._position is not None:
                way = self._sensed[self._position] - before[self._position]
                path += math.sqrt(float(way.dot(way)))
            flag = found != NO_FAILURE
            over = self._is_over and not self._is_done
            first = flag and kind == NO_FAILURE and (not muted or over)
            muted = muted and flag
            if first:
                kind, kind_step = found, steps
            if over or (first and job.stop_on_failure):
                return JobResult(Reason.FAILURE, steps, memory, kind, kind_step, muted, path)
            if job.command is not None or steps == job.most:
                return JobResult(GOES_ON, steps, memory, kind, kind_step, muted, path)

    def draw(self) -> npt.NDArray[np.uint8]:
        """[H, W, 3] a picture of the present row.

        Raises:
            ConfigError: the environment draws none.
        """
        picture = self.definition.draw(self.env) if self.definition.draw else self.env.render()
        if not isinstance(picture, np.ndarray) or picture.ndim != 3:
            raise ConfigError(
                "the environment draws no picture: make it with render_mode='rgb_array', or give the world `draw(env)`"
            )
        return np.ascontiguousarray(picture[:, :, :3], dtype=np.uint8)

    @property
    def observation(self) -> Array:
        """[D] the truth."""
        return self._sensed[: self.layout.size]

    @property
    def last_action(self) -> Array:
        """[A]."""
        return self._sensed[self.layout.size : -2]

    def _seen(self, shift: Array) -> Any:
        """The observation as the robot has it, in the environment's form; it shares no memory with the row."""
        shifted = self._sensed[: self.layout.size] + shift
        return shifted if self._is_flat else self.layout.structure(shifted)

    def _step(self, action: Array, shift: Array, name: str, step: int) -> tuple[Any, int, str]:
        """One control step: what the robot sees, the kind of failure, and what went wrong if the row diverged."""
        try:
            observation, reward, terminated, truncated, info = self.env.step(self.layout.to_action(action))
        except Exception as error:
            return None, NO_FAILURE, f"env.step: {type(error).__name__}: {error}"
        info = {**info, "controller": name, "controller_step": step, "reward": float(reward)}
        over = 1 if terminated else 2 if truncated else 0
        self._sense(observation, info, action, over=over)
        # the square of a sound row is finite, and faster to tell than that all its numbers are
        if not math.isfinite(self._sensed.dot(self._sensed)) and not np.isfinite(self._sensed).all():
            return None, NO_FAILURE, f"the observation holds NaN or infinity{self._bad()}"
        if over and not self._is_done:
            return None, self._kinds[ENDS[over - 1]], ""
        seen = self._seen(shift)
        try:
            found = self.definition.failed(info, seen)
            return seen, NO_FAILURE if found is None else self._kind(found), ""
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise ConfigError(f"failed(info, obs): {type(error).__name__}: {error}") from error

    def _kind(self, found: Any) -> int:
        if found is False or (isinstance(found, np.bool_) and not found):
            return NO_FAILURE
        if isinstance(found, str):
            if found not in self._kinds:
                raise ConfigError(f"failed(info, obs) says '{found}'; failure_kinds are {', '.join(self._kinds)}")
            return self._kinds[found]
        return 0

    def _sense(self, observation: Any, info: Any, action: Array, *, over: int = 0) -> None:
        size = self.layout.size
        sensed = np.empty(size + len(action) + 2)
        try:
            self.layout.write(observation, sensed[:size])
        except (TypeError, ValueError, AttributeError, KeyError) as error:
            raise ShapeError(f"the observation has changed its form: {error}") from error
        try:
            done = info is not None and bool(self.definition.success(info, observation))
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise ConfigError(f"success(info, obs): {type(error).__name__}: {error}") from error
        sensed[size:-2], sensed[-2], sensed[-1] = action, done, over
        self._sensed, self._is_done, self._is_over = sensed, done, over > 0

    def _bad(self) -> str:
        bad = [key for key, part in self.layout.parts.items() if not np.isfinite(self._sensed[part.where]).all()]
        return f" in '{bad[0]}'" if bad else ""


def failure_kinds(own: Sequence[str]) -> tuple[str, ...]:
    """A person's kinds, then the environment's own ends."""
    return (*own, *ENDS)

"""A world out of an environment that steps, and whose state can be taken and put back.

    world = GymnasiumWorld(
        "fetch", make_env, controllers=[Controller("reach", reach, max_steps=30), …],
        success=lambda info, obs: info["is_success"], primitives=box_primitives(0.5, 5, ["x", "y", "z", "grip"]),
    )

keeps the contract of `p2l.contracts.world`, so that failures are discovered and grouped, and recoveries learnt, as in
any other. Environments run in processes (`processes`), which carry out whole options (`runner`). What is restored is
tried when the world is made (`check`).

1. A detector sees what the robot sees, with its errors; the goal is judged on the truth.
2. When the environment ends without the task being done, that is a failure (`terminated`, `truncated`).

Axis letters: N rows, D numbers of an observation, A of an action, E estimated coordinates.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from p2l.artifacts import config_hash
from p2l.contracts.estimator import Estimator, Mode
from p2l.contracts.observation import Observation, Privileged
from p2l.contracts.option import Option
from p2l.contracts.rows import Command, Rows
from p2l.contracts.world import NO_FAILURE
from p2l.errors import ConfigError
from p2l.records import Array, BoolArray, IntArray
from p2l.skills.runner import Reason
from p2l.worlds.gymnasium.jobs import Moment, OptionJob
from p2l.worlds.gymnasium.layout import Noise, NoiseMap
from p2l.worlds.gymnasium.options import ACTION, BoundOption, Controller, HeldAction
from p2l.worlds.gymnasium.processes import Processes
from p2l.worlds.gymnasium.runner import ProcessRunner
from p2l.worlds.gymnasium.simulation import Definition, failure_kinds

ROW_VERSION = 1  # raise when the meaning of a saved row changes
_AT_ONCE = 32  # rows that a call without slots hands to the processes


class GymnasiumWorld:
    """An environment as a world.

    Args:
        name: for files, tables and messages.
        make_env: makes one environment with gymnasium's interface; called in each process.
        controllers: the nominal skills, in order.
        success: whether the task is done, from a step's `info` and observation (the truth).
        primitives: a recovery's own actions; `box_primitives` makes some.
        failed: what has gone wrong, from a step's `info` and the observation that the robot has: None, one of
            `failures`, or True for the first of these. `info` also has `controller` (the option at work),
            `controller_step` and `reward`.
        failures: names of what `failed` can say.
        noise: errors of the robot's estimates; they develop as `estimator` says.
        estimator: see `contracts.estimator.Estimator`.
        fields: names for parts of the observation, e.g. `{"grip_pos_m": "observation[0:3]"}`; what is not named keeps
            its key.
        position: part of the observation that is the end effector's position, whose way is measured; none without it.
        mode_fields: what tells failures apart, see `contracts.world.World`; all fields without any.
        get_state: fields of the whole state of an environment, plain values and arrays; by default all that is known to
            matter in environments on MuJoCo (`physics`).
        set_state: puts an environment into such a state.
        draw: a picture [H, W, 3] of an environment; its `render()` by default.
        control_period_s: of a control step; the environment's `dt` by default.
        processes: environments that work at the same time.

    Raises:
        ConfigError: the environment cannot be sent to a process, made, driven or restored; one message says why.

    Example:
        >>> import gymnasium
        >>> import numpy as np
        >>> from p2l import GymnasiumWorld
        >>> from p2l.worlds.gymnasium import Controller, box_primitives
        >>> world = GymnasiumWorld(
        ...     "pole",
        ...     lambda: gymnasium.make("InvertedPendulum-v5"),
        ...     [Controller("balance", lambda obs, memory: (5 * obs[1:2], memory + 1, memory[0] == 20), 30, 1)],
        ...     success=lambda info, obs: abs(obs[1]) < 0.1,
        ...     primitives=box_primitives(1.0, 3, ["push"]),
        ...     processes=1,
        ... )
        >>> rows = world.sample(np.random.default_rng(0), 2)
        >>> [option.name for option in (*world.primitives(), *world.nominal_options())], world.goal(rows).tolist()
        (['+push', '-push', 'balance'], [False, False])
    """

    def __init__(
        self,
        name: str,
        make_env: Callable[[], Any],
        controllers: Sequence[Controller],
        success: Callable[[Any, Any], bool],
        *,
        primitives: Sequence[HeldAction] = (),
        failed: Callable[[Any, Any], Any] = lambda info, obs: None,  # noqa: ARG005
        failures: Sequence[str] = ("failed",),
        noise: Sequence[Noise] = (),
        estimator: Mode = "fixed",
        fields: Mapping[str, str] | None = None,
        position: str | None = None,
        mode_fields: Sequence[str] = (),
        get_state: Callable[[Any], Mapping[str, Any]] | None = None,
        set_state: Callable[[Any, Mapping[str, Any]], None] | None = None,
        draw: Callable[[Any], Any] | None = None,
        control_period_s: float | None = None,
        processes: int = 2,
    ) -> None:
        self.name, self.failure_kinds = name, failure_kinds(failures)
        if len(set(self.failure_kinds)) < len(self.failure_kinds):
            raise ConfigError(f"world '{name}': failures {', '.join(failures)} repeat each other, or the environment's")
        if not failures:
            raise ConfigError(f"world '{name}': failures is empty; name at least one kind that `failed` can say")
        if (get_state is None) != (set_state is None):
            raise ConfigError(f"world '{name}': give both get_state and set_state, or neither")
        if processes < 1:
            raise ConfigError(f"world '{name}': {processes} processes given; it needs at least one")
        self._definition = Definition(
            make_env, tuple(controllers), tuple(primitives), success, failed, self.failure_kinds, tuple(noise),
            position, get_state, set_state, draw,
        )  # fmt: skip
        self.processes = Processes(name, self._definition, processes)
        self._drawing: Processes | None = None
        facts = self.processes.facts
        self._layout = facts.layout
        self._noise = NoiseMap.of(self._layout, self._definition.noise)
        self._fields = self._layout.fields(dict(fields or {}))
        self.estimator = Estimator(estimator, self._noise.sigma)
        self.mode_fields = tuple(mode_fields) or tuple(self._fields)
        self._position = None if position is None else self._layout.place(position)
        period = control_period_s or facts.control_period_s
        if not period > 0.0:
            raise ConfigError(f"world '{name}': how long is a control step? Say control_period_s=<seconds>")
        self.control_period_s = period
        self.command_columns: Mapping[str, slice] = {ACTION: slice(0, self._layout.action_size)}
        bound = [BoundOption(option, self._layout, self._fields) for option in self._definition.options]
        self._primitives, self._controllers = tuple(bound[: len(primitives)]), tuple(bound[len(primitives) :])
        parts = {key: [part.where.start, list(part.shape), part.dtype] for key, part in self._layout.parts.items()}
        places = {field: [where.start, where.stop] for field, where in self._fields.items()}
        skills = [[option.name, option.max_steps] for option in bound]
        noisy = [list(self._noise.sigma), self._noise.target.tolist(), self._noise.source.tolist()]
        self.digest = config_hash(
            [ROW_VERSION, name, list(facts.identity), parts, places, skills, noisy, list(self.failure_kinds)]
        )

    def sample(self, rng: np.random.Generator, n: int) -> Rows:
        """Start states: resets with seeds drawn from `rng`."""
        seeds = rng.integers(2**31, size=n).tolist()
        moments = [moment for moment, _ in self._work("reset", seeds, None)]
        noise = self.estimator.draw(rng, n)
        return self._rows(moments, noise, np.zeros(n, dtype=np.int64))

    def advance(self, rows: Rows, command: Command) -> tuple[Rows, IntArray, BoolArray]:
        """One `env.step` of each row; its state is put before and taken after, unlike in a runner of this world."""
        errors = self.estimate_error(rows)
        jobs = [
            OptionJob(0, 0, np.zeros(0), error, NO_FAILURE, False, False, 1, action)
            for error, action in zip(errors, command.values, strict=True)
        ]
        answers = list(self._work("run", jobs, rows))
        diverged = np.array([outcome.reason == Reason.DIVERGENCE for _, outcome in answers], dtype=np.bool_)
        kind = np.array([outcome.kind for _, outcome in answers], dtype=np.int64)
        after = self._rows([moment for moment, _ in answers], rows.noise, rows.actions)
        after.put(diverged, rows.take(diverged))
        return after, kind, diverged

    def path_m(self, before: Rows, after: Rows) -> Array:
        """Of `position`; zeros without it."""
        if self._position is None:
            return np.zeros(len(before))
        way = after.sensors[:, self._position] - before.sensors[:, self._position]
        return np.asarray(np.sqrt((way * way).sum(axis=1)))

    def privileged(self, rows: Rows) -> Privileged:
        """The observation without errors."""
        return Privileged.of({name: rows.sensors[:, where] for name, where in self._fields.items()})

    def observe(self, rows: Rows) -> Observation:
        """The observation with errors, the last action, and the number of actions (options or primitives) so far."""
        shift = self._noise.shift(self.estimate_error(rows), self._layout.size)
        seen = rows.sensors[:, : self._layout.size] + shift
        fields = {name: seen[:, where] for name, where in self._fields.items()}
        last = rows.sensors[:, self._layout.size : -2]
        return Observation.of({**fields, "last_action": last, "actions": rows.actions})

    def goal(self, rows: Rows) -> BoolArray:
        """What `success` has said after the last step."""
        return np.asarray(rows.sensors[:, -2] > 0.5)

    def nominal_options(self) -> tuple[Option, ...]:
        """The controllers."""
        return self._controllers

    def primitives(self) -> tuple[Option, ...]:
        """The held actions."""
        return self._primitives

    def pictures(self, rows: Rows, gl: str) -> Sequence[npt.NDArray[np.uint8]]:
        """[N] of [H, W, 3], by a process of its own: whether MuJoCo can draw is decided when it is imported.

        Args:
            rows: [N].
            gl: MuJoCo's backend, `egl` or `osmesa`.
        """
        if self._drawing is None:
            self._drawing = Processes(self.name, self._definition, 1, facts=self.processes.facts, gl=gl)
        return [picture for _, picture in self._work("draw", [None] * len(rows), rows, self._drawing)]

    def runner(self, options: Sequence[Option], slots: int, *, stop_on_failure: bool) -> ProcessRunner | None:
        """A runner in whose slots whole options run; None for options that are not this world's."""
        own = [*self._primitives, *self._controllers]
        places = [own.index(option) for option in options if option in own]
        if len(places) < len(options):
            return None
        error = self.estimate_error
        return ProcessRunner(self, self.processes, error, options, places, slots, stop_on_failure=stop_on_failure)

    def estimate_error(self, rows: Rows) -> Array:
        """[N, E] what is added to the truth."""
        return self.estimator.error(rows.noise, rows.actions)

    def _work(self, what: str, contents: Sequence[Any], rows: Rows | None, who: Processes | None = None) -> Any:
        """The row and the answer of a job for each of `contents`, in order."""
        processes = who or self.processes
        lanes = processes.take_lanes(min(_AT_ONCE, max(len(contents), 1)))
        try:
            for first in range(0, len(contents), len(lanes)):
                part = range(first, min(first + len(lanes), len(contents)))
                tickets = []
                for lane, place in zip(lanes.tolist(), part, strict=False):
                    row = None if rows is None else Moment(memoryview(rows.states[place]), rows.sensors[place])
                    tickets.append(processes.submit(lane, what, contents[place], row))
                for lane, ticket in zip(lanes.tolist(), tickets, strict=False):
                    answer = processes.collect(ticket)
                    state, sensed = processes.row(lane)
                    yield Moment(state.tobytes(), sensed.copy()), answer
        finally:
            processes.give_lanes(lanes.tolist())

    def _rows(self, moments: Sequence[Moment], noise: Array, actions: IntArray) -> Rows:
        count, nothing = len(moments), np.zeros((len(moments), 0))
        states = np.zeros((count, self.processes.facts.state_bytes), dtype=np.uint8)
        sensed = np.zeros((count, self._layout.size + self._layout.action_size + 2))
        for place, moment in enumerate(moments):
            states[place], sensed[place] = np.frombuffer(moment.state, dtype=np.uint8), moment.sensed
        index = np.zeros(count, dtype=np.int64)
        return Rows(states, sensed, index, noise.copy(), actions.copy(), nothing, np.zeros(count))  # type: ignore[arg-type]

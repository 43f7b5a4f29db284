"""A world whose physics, control and judgement are robosuite's; all else is that of one of our worlds.

Its rows are those of that world with one more column of memory, which holds robosuite's own verdict after the last
control step. Failure detectors are our world's, on robosuite's sensors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Literal, get_args

import mujoco
import numpy as np

from p2l.contracts.estimator import Estimator
from p2l.contracts.observation import Observation, Privileged
from p2l.contracts.option import Option
from p2l.contracts.rows import Command, Rows
from p2l.contracts.world import Scenic, View, World
from p2l.errors import ConfigError
from p2l.records import Array, BoolArray, IntArray
from p2l.sim.batch import Chunk
from p2l.skills import chain
from p2l.worlds.robosuite.engine import RobosuiteEngine
from p2l.worlds.robosuite.environments import environment, scene_of
from p2l.worlds.robosuite.gains import Gains, impedance_gains
from p2l.worlds.robot import GRIP, engine_step

Tuning = Literal["matched", "own"]


class TransferWorld:
    """Keeps the contract of `contracts.world.World`, one row at a time; see `make`."""

    def __init__(self, world: Scenic, engine: RobosuiteEngine) -> None:
        self._world, self._engine = world, engine

    @property
    def name(self) -> str:
        """That of our world."""
        return self._world.name

    @property
    def digest(self) -> str:
        """That of our world: rows mean the same."""
        return self._world.digest

    @property
    def engine(self) -> RobosuiteEngine:
        """What steps robosuite."""
        return self._engine

    @property
    def control_period_s(self) -> float:
        """Of the engine."""
        return self._engine.control_period_s

    @property
    def command_columns(self) -> Mapping[str, slice]:
        """Those of our world."""
        return self._world.command_columns

    @property
    def estimator(self) -> Estimator:
        """That of our world."""
        return self._world.estimator

    @property
    def failure_kinds(self) -> tuple[str, ...]:
        """Those of our world."""
        return self._world.failure_kinds

    @property
    def mode_fields(self) -> tuple[str, ...]:
        """Those of our world."""
        return self._world.mode_fields

    @property
    def view(self) -> View:
        """That of our world."""
        return self._world.view

    def sample(self, rng: np.random.Generator, n: int) -> Rows:
        """Start states of our world."""
        return self.adopt(self._world.sample(rng, n))

    def adopt(self, rows: Rows) -> Rows:
        """Rows of our world as rows of this one, e.g. recorded failures."""
        return replace(rows, memory=np.column_stack([rows.memory, np.zeros(len(rows))]))

    def original(self, rows: Rows) -> Rows:
        """Rows of this world as rows of ours."""
        return replace(rows, memory=rows.memory[:, :-1])

    def privileged(self, rows: Rows) -> Privileged:
        """The truth, with the fields of our world."""
        return self._world.privileged(self.original(rows))

    def observe(self, rows: Rows) -> Observation:
        """What the robot sees, with the fields of our world."""
        return self._world.observe(self.original(rows))

    def advance(self, rows: Rows, command: Command) -> tuple[Rows, IntArray, BoolArray]:
        """One `env.step` of robosuite, then the detectors."""
        return engine_step(self, rows, command)

    def path_m(self, before: Rows, after: Rows) -> Array:
        """Of the grip site."""
        place = self._engine.sensor_columns[GRIP]
        return np.asarray(np.linalg.norm(after.sensors[:, place] - before.sensors[:, place], axis=1))

    def control(self, command: Command) -> Array:
        """Controls of our engine; the stiffnesses among them mean nothing to robosuite."""
        return self._world.control(command)

    def monitor(self, before: Rows, after: Rows, chunk: Chunk, command: Command) -> tuple[IntArray, Array]:
        """Our detectors, and robosuite's verdict."""
        kind, memory = self._world.monitor(self.original(before), self.original(after), chunk, command)
        return kind, np.column_stack([memory, [float(self._engine.success())]])

    def goal(self, rows: Rows) -> BoolArray:
        """The verdict of robosuite after the last control step; False of rows that have not been moved yet."""
        return np.asarray(rows.memory[:, -1] > 0)

    def nominal_options(self) -> tuple[Option, ...]:
        """Those of our world."""
        return self._world.nominal_options()

    def primitives(self) -> tuple[Option, ...]:
        """Those of our world."""
        return self._world.primitives()

    def visual_model(self, model: int) -> mujoco.MjModel:
        """That of our world."""
        return self._world.visual_model(model)


def make(world: World, *, tuning: Tuning | Gains = "matched", objects: bool = False) -> TransferWorld:
    """An environment of robosuite behind the contract of a world.

    Args:
        world: with robosuite's task, the Panda, and no variation that robosuite's own scene does not have; or a shelf.
        tuning: of OSC_POSE, `matched` to the impedance of the world's skills, robosuite's `own`, or these gains.
        objects: whether robosuite observes objects too; nothing here reads that, it costs what its users pay.

    Raises:
        ConfigError: there is no such task in robosuite, or the world is a variant that it does not have.
    """
    if not isinstance(world, Scenic):
        raise ConfigError(f"robosuite has no task like world '{world.name}'")
    scene = scene_of(world)
    if not isinstance(tuning, Gains) and tuning not in get_args(Tuning):
        raise ConfigError(f"unknown tuning '{tuning}'; known: {', '.join(get_args(Tuning))}")
    if tuning == "matched":
        gains = impedance_gains(scene, world.engine.qpos(world.sample(np.random.default_rng(0), 1).states)[0])
    else:
        gains = tuning if isinstance(tuning, Gains) else Gains()
    return TransferWorld(world, RobosuiteEngine(environment(world, scene, gains, objects=objects), world.engine, scene))


def execute(
    transfer: TransferWorld,
    options: Sequence[Option],
    start: Rows,
    *,
    first: IntArray | None = None,
    choose: chain.Choose | None = None,
    stop_on_failure: bool = True,
    progress: Callable[[int], None] | None = None,
) -> chain.Execution:
    """Run one episode from every row of our world (starts, or recorded failures); arguments as in `chain.run`.

    Success is robosuite's verdict; where failures stop an episode, a flagged one is none.
    """
    return chain.run(
        transfer,
        options,
        transfer.adopt(start),
        first=first,
        choose=choose,
        stop_on_failure=stop_on_failure,
        slots=1,
        progress=progress,
    )

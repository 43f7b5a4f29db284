"""The contract of a manipulation world, and the moment of an execution that everything is a function of.

Axis letters: N rows, S state columns, D sensor values, E estimated coordinates, M columns of a world's memory.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Protocol, runtime_checkable

import mujoco
import numpy as np
import numpy.typing as npt

from p2l.contracts.estimator import Estimator
from p2l.contracts.observation import Observation, Privileged
from p2l.errors import ShapeError
from p2l.records import Array, BoolArray, IntArray
from p2l.sim.batch import Chunk, Engine

NO_FAILURE = -1


@dataclass(frozen=True)
class Rows:
    """N executions at one moment; with the commands to come it decides their future to the bit.

    Attributes:
        states: [N, S] rows of the engine.
        sensors: [N, D] last sensor values.
        model: [N] which of the engine's models each row uses.
        noise: [N, K, E] unit normals of the state estimator, see `worlds.estimator`.
        actions: [N] actions (options or primitives) finished so far.
        memory: [N, M] what the world's failure detectors remember, e.g. the pose of a box in the hand.
        grip: [N] last command to the fingers, 0 = open, 1 = closed.
    """

    states: Array
    sensors: Array
    model: IntArray
    noise: Array
    actions: IntArray
    memory: Array
    grip: Array

    def __len__(self) -> int:
        return len(self.states)

    def take(self, index: npt.ArrayLike) -> Rows:
        """The rows of `index` (integers or a mask), in that order."""
        rows = np.asarray(index)
        return Rows(**{name: value[rows] for name, value in self.arrays().items()})

    def put(self, index: npt.ArrayLike, rows: Rows) -> None:
        """Overwrite the rows of `index`; only who made this record's arrays may do so (the runner's slots)."""
        where = np.asarray(index)
        for name, value in self.arrays().items():
            value[where] = getattr(rows, name)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """The fields by name, for `artifacts.save_arrays`."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> Rows:
        """From what `arrays` gave.

        Raises:
            ShapeError: the fields do not have the same number of rows, or hold NaN.
        """
        made = cls(**{field.name: np.array(arrays[field.name]) for field in fields(cls)})
        counts = {name: len(value) for name, value in made.arrays().items()}
        if len(set(counts.values())) > 1:
            raise ShapeError(f"rows: the fields have different numbers of rows: {counts}")
        if bad := [name for name, value in made.arrays().items() if not np.isfinite(value).all()]:
            raise ShapeError(f"rows: {', '.join(bad)} hold NaN or infinity")
        return made

    @classmethod
    def join(cls, parts: Sequence[Rows]) -> Rows:
        """The rows of all parts, in order."""
        return cls(**{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(cls)})


@dataclass(frozen=True)
class Command:
    """What the arm is asked for during the next control step.

    Attributes:
        pos: [N, 3] of the grip site's target, world frame, m.
        quat: [N, 4] of the target, (w, x, y, z).
        grip: [N] 0 = fingers open, 1 = closed.
    """

    pos: Array
    quat: Array
    grip: Array


@dataclass(frozen=True)
class View:
    """Where the camera of a video stands.

    Attributes:
        azimuth_deg: direction it looks in, from the world's x axis to its y axis.
        elevation_deg: negative looks down.
        distance_m: from the point it looks at.
        lookat_m: that point, world frame; None follows what the hand does.
    """

    azimuth_deg: float = 130.0
    elevation_deg: float = -25.0
    distance_m: float = 1.0
    lookat_m: tuple[float, float, float] | None = None


@runtime_checkable
class World(Protocol):
    """A distribution of start states, a physics, what is seen of it, and when it has failed or is done."""

    @property
    def name(self) -> str:
        """The registered name."""

    @property
    def digest(self) -> str:
        """Hash of everything that gives a saved row its meaning (scene, physics, columns); files carry it."""

    @property
    def engine(self) -> Engine:
        """The batched engine; a row's `model` counts its models."""

    @property
    def estimator(self) -> Estimator:
        """How the robot's estimate errs."""

    @property
    def failure_kinds(self) -> tuple[str, ...]:
        """Names of what the detectors can say; a kind is an index into them, `NO_FAILURE` (−1) means none."""

    @property
    def mode_fields(self) -> tuple[str, ...]:
        """What tells failures apart: fields of `privileged`, or differences of two, e.g. `grip_pos_m - handle_pos_m`.

        Empty stands for the hand relative to everything that has a position, and every length and angle of one column.
        """

    @property
    def view(self) -> View:
        """Where a video is taken from."""

    def sample(self, rng: np.random.Generator, n: int) -> Rows:
        """N start states."""

    def privileged(self, rows: Rows) -> Privileged:
        """The truth."""

    def observe(self, rows: Rows) -> Observation:
        """What the robot sees; estimates err by `estimator`."""

    def control(self, command: Command) -> Array:
        """[N, U] controls of the engine: stiffnesses and fingers."""

    def monitor(self, before: Rows, after: Rows, chunk: Chunk, command: Command) -> tuple[IntArray, Array]:
        """The detectors after one control step: the kind of failure [N] and the new memory [N, M].

        `after.memory` is still that of `before`.
        """

    def goal(self, rows: Rows) -> BoolArray:
        """[N] whether the task is done, judged on the truth."""

    def drawn(self, model: int) -> mujoco.MjModel:
        """The twin of one of the engine's models that has visuals, for videos."""


def advance(world: World, rows: Rows, command: Command) -> tuple[Rows, IntArray, BoolArray]:
    """One control step: the rows after it, the kind of failure [N], and which rows diverged [N]."""
    control = world.control(command)
    chunk = world.engine.step(rows.states, command.pos, command.quat, control, rows.model)
    sensors = np.array(chunk.sensors[:, -1])
    after = replace(rows, states=chunk.states, sensors=sensors, grip=np.asarray(command.grip, dtype=np.float64))
    kind, memory = world.monitor(rows, after, chunk, command)
    return replace(after, memory=memory), kind, chunk.diverged

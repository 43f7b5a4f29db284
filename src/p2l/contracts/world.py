"""The contract of a manipulation world.

Axis letters: N rows, U controls of the engine, M columns of a world's memory.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from p2l.contracts.estimator import Estimator
from p2l.contracts.observation import Observation, Privileged
from p2l.contracts.option import Option
from p2l.contracts.rows import Command, Rows
from p2l.contracts.symbols import Symbols
from p2l.errors import ConfigError
from p2l.records import Array, BoolArray, IntArray

if TYPE_CHECKING:  # tables and figures of finished runs load no simulator
    import mujoco

    from p2l.sim.batch import Chunk, Engine

NO_FAILURE = -1


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
    """A distribution of start states, a simulator, what is observed of it, failure detectors and a goal.

    This is all that discovery, clustering, the learners and evaluation ask for. Rows can be kept, copied and gone on
    from in any batch; `advance` is a control step of any of them.
    """

    @property
    def name(self) -> str:
        """The registered name."""

    @property
    def digest(self) -> str:
        """Hash of everything that gives a saved row its meaning (scene, physics, columns); files carry it."""

    @property
    def control_period_s(self) -> float:
        """Simulated seconds of a control step."""

    @property
    def command_columns(self) -> Mapping[str, slice]:
        """Columns of a command, by name; `contracts.rows.POSE` for a hand with an impedance target."""

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

    def sample(self, rng: np.random.Generator, n: int) -> Rows:
        """N start states."""

    def advance(self, rows: Rows, command: Command) -> tuple[Rows, IntArray, BoolArray]:
        """One control step: the rows after it, the kind of failure [N], and which rows diverged [N]."""

    def path_m(self, before: Rows, after: Rows) -> Array:
        """[N] way of the end effector in a control step, m; zeros where there is none."""

    def privileged(self, rows: Rows) -> Privileged:
        """The truth."""

    def observe(self, rows: Rows) -> Observation:
        """What the robot observes; estimates err by `estimator`."""

    def goal(self, rows: Rows) -> BoolArray:
        """[N] whether the task is done, judged on the truth."""

    def nominal_options(self) -> tuple[Option, ...]:
        """The nominal chain π_1 … π_k, in order."""

    def primitives(self) -> tuple[Option, ...]:
        """A recovery's own actions, short options that apply everywhere."""


@runtime_checkable
class Scenic(World, Protocol):
    """A world whose rows are those of our batched engine, which can draw them."""

    @property
    def engine(self) -> Engine:
        """The batched engine; a row's `model` counts its models."""

    @property
    def view(self) -> View:
        """Where a video is taken from."""

    def control(self, command: Command) -> Array:
        """[N, U] controls of the engine: stiffnesses and fingers."""

    def monitor(self, before: Rows, after: Rows, chunk: Chunk, command: Command) -> tuple[IntArray, Array]:
        """The detectors after one control step: the kind of failure [N] and the new memory [N, M].

        `after.memory` is still that of `before`.
        """

    def visual_model(self, model: int) -> mujoco.MjModel:
        """One of the engine's models with its visual geoms, for videos."""


@runtime_checkable
class Pictured(Protocol):
    """A world that draws its rows itself, for example by its environment's own `render`."""

    def pictures(self, rows: Rows, gl: str) -> Sequence[npt.NDArray[np.uint8]]:
        """[N] of [H, W, 3]; `gl` is a backend that can draw here, `egl` or `osmesa`."""


@runtime_checkable
class Symbolic(Protocol):
    """A world with a skill graph (chapter 4)."""

    def symbols(self) -> Symbols:
        """How its states are described to preconditions and recoveries."""


@runtime_checkable
class Delivering(Protocol):
    """A world whose task is to bring its object (`object_pos_m` of the truth) somewhere."""

    def delivery_pos(self, truth: Privileged) -> Array:
        """[N, 3] where the object belongs, world frame, m."""


@runtime_checkable
class Strategic(Protocol):
    """A world that can tell by which strategies a recovery got out of a failure."""

    def strategies(self, before: Rows, after: Rows) -> Mapping[str, BoolArray]:
        """[N] by name, which strategies the recovery from `before` [N] to its last decision `after` [N] shows."""


def symbols_of(world: World) -> Symbols:
    """How a world is described to preconditions and recoveries.

    Raises:
        ConfigError: it is not.
    """
    if not isinstance(world, Symbolic):
        raise ConfigError(f"world '{world.name}' has no symbols, so no skill graph: its class has no method `symbols`")
    return world.symbols()

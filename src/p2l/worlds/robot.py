"""What every world with an arm shares: rows out of postures, named readings, control; a world states only its physics.

A world subclasses `RobotWorld` and gives `sample`, `_truth`, `_observation`, `monitor`, `goal` and `nominal_options`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from p2l.artifacts import config_hash
from p2l.closure import outside_code
from p2l.contracts.estimator import Estimator
from p2l.contracts.observation import Observation, Privileged
from p2l.contracts.option import Option
from p2l.contracts.rows import POSE, Command, Rows
from p2l.contracts.world import Scenic, View
from p2l.errors import ConfigError
from p2l.records import Array, BoolArray, IntArray
from p2l.sim.batch import Chunk, Engine
from p2l.sim.scene import Scene
from p2l.skills import primitives
from p2l.worlds.physics import VERSION, varied

ROW_VERSION = 1  # raise when the meaning of a saved row changes
GRIP = "grip_pos"
HAND = ("grip_quat", "target_quat")
Fields = Mapping[str, npt.NDArray[np.generic]]


def engine_step(world: Scenic, rows: Rows, command: Command) -> tuple[Rows, IntArray, BoolArray]:
    """One control step of the engine: the rows after it, the kind of failure [N], and which rows diverged [N]."""
    control = world.control(command)
    chunk = world.engine.step(rows.states, command.pos, command.quat, control, rows.model)
    sensors = np.array(chunk.sensors[:, -1])
    after = replace(rows, states=chunk.states, sensors=sensors, grip=np.array(command.grip))
    kind, memory = world.monitor(rows, after, chunk, command)
    return replace(after, memory=memory), kind, chunk.diverged


def _resembling(quat: Array, like: Array) -> Array:
    """[N, 4] of q and −q, which are the same orientation, the one that is nearer to `like` [4]."""
    return np.where((quat @ like < 0.0)[:, None], -quat, quat)


class RobotWorld:
    """The algebra of a world; see `contracts.world.World` for the contract.

    Args:
        name: the registered name.
        params: the world's parameters; part of its digest.
        scenes: interchangeable scenes, one for each model of the engine.
        estimator: how estimates err.
        control_period_s: duration of a control step.
        nthread: simulator threads.

    Raises:
        ConfigError: the class does not give what a world states itself.
    """

    failure_kinds: tuple[str, ...] = ()
    memory_size: int = 0
    mode_fields: tuple[str, ...] = ()
    view: View = View()
    command_columns: Mapping[str, slice] = POSE
    hand_like: Array | None = None  # what the quaternions `HAND` resemble as they are observed, see `observe_hand_as`

    def __init__(
        self,
        name: str,
        params: Mapping[str, Any],
        scenes: Sequence[Scene],
        estimator: Estimator,
        *,
        control_period_s: float = 0.05,
        nthread: int = 2,
    ) -> None:
        own = ("sample", "_truth", "_observation", "monitor", "goal", "nominal_options")
        if lacking := [each for each in own if getattr(type(self), each) is getattr(RobotWorld, each)]:
            raise ConfigError(
                f"world '{name}': {type(self).__name__} lacks {', '.join(lacking)}; see docs/new-world.md"
            )
        self.name, self.scenes, self.estimator = name, tuple(scenes), estimator
        self.version = int(params.get("version", VERSION))
        self.engine = Engine([scene.model for scene in scenes], control_period_s=control_period_s, nthread=nthread)
        first, physics = scenes[0], scenes[0].physics
        self._stiffness = self.engine.stiffness(1, physics.stiffness_linear, physics.stiffness_angular)
        self._stiffness[:, self.engine.impedance_columns] *= physics.axis_scale
        joints = [first.model.joint(i).name for i in range(first.model.njnt)]
        # A row carries unit normals, so it means the same to every estimator and on any number of threads.
        digest_params = {key: value for key, value in params.items() if key not in ("estimator", "nthread")}
        if digest_params.get("version") == 1:  # what is known of its rows was written when it was the only one
            del digest_params["version"]
        digest_params = varied(digest_params)
        columns = [list(self.engine.sensor_columns), list(self.engine.furniture)]
        # ROW_VERSION marks the edits of our worlds after which a saved row means something else; others have no such.
        module = type(self).__module__
        outside = [] if module.startswith("p2l.") else [outside_code([module]), self.engine.fingerprint()]
        self.digest = config_hash([ROW_VERSION, name, digest_params, joints, *columns, *outside])
        self._fingers = {self.engine.control_names.index(act): ends for act, ends in first.fingers.items()}
        single = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
        self._single = {name for name in joints if first.model.joint(name).type[0] in single}
        self._columns: dict[str, int] = {j: 1 + int(first.model.joint(j).qposadr[0]) for j in joints}
        fingers = [column for name, column in self._columns.items() if "finger_joint" in name]
        self._finger_columns = np.array(fingers, dtype=np.int64)
        self._arm = [self._columns[name] for name in first.arm_joints]

    @property
    def control_period_s(self) -> float:
        """Of the engine."""
        return self.engine.control_period_s

    def advance(self, rows: Rows, command: Command) -> tuple[Rows, IntArray, BoolArray]:
        """One batch of the engine, then the detectors."""
        return engine_step(self, rows, command)

    def path_m(self, before: Rows, after: Rows) -> Array:
        """Of the grip site."""
        return np.asarray(np.linalg.norm(self.read(after, GRIP) - self.read(before, GRIP), axis=1))

    def primitives(self) -> tuple[Option, ...]:
        """Small motions of the hand (thesis, section 5.4)."""
        return primitives.of_version(self.version)

    def visual_model(self, model: int) -> mujoco.MjModel:
        """The model with visual geoms."""
        return self.scenes[model].visual_model

    def control(self, command: Command) -> Array:
        """[N, U]: the scene's stiffnesses, and the fingers between open and closed."""
        control = np.repeat(self._stiffness, len(command.grip), axis=0)
        for column, (open_control, closed_control) in self._fingers.items():
            control[:, column] = open_control + command.grip * (closed_control - open_control)
        return control

    def privileged(self, rows: Rows) -> Privileged:
        """The truth."""
        return Privileged.of(self._truth(rows))

    def observe(self, rows: Rows) -> Observation:
        """What the robot observes; its own commands (target pose, grip) are always part of it."""
        error = self.estimator.error(rows.noise, rows.actions)
        target = self.target(rows)
        own = {"target_pos_m": target[:, :3], "target_quat": target[:, 3:], "grip_command": rows.grip}
        fields = {**self._observation(rows, error), **own}
        if self.hand_like is not None:
            fields |= {name: _resembling(np.asarray(fields[name], dtype=np.float64), self.hand_like) for name in HAND}
        return Observation.of(fields)

    def observe_hand_as(self, like: npt.ArrayLike) -> None:
        """Observe the hand's orientation as that of q and −q, which are the same, that resembles `like` [4] more.

        Which of them the joints of an arm, or another simulator, come up with is an accident. A policy would take one
        for the other's opposite.
        """
        self.hand_like = np.asarray(like, dtype=np.float64)

    def sample(self, rng: np.random.Generator, n: int) -> Rows:
        """N start states."""
        raise NotImplementedError

    def _truth(self, rows: Rows) -> Fields:
        raise NotImplementedError

    def _observation(self, rows: Rows, error: Array) -> Fields:
        raise NotImplementedError

    def monitor(self, before: Rows, after: Rows, chunk: Chunk, command: Command) -> tuple[IntArray, Array]:
        """The detectors."""
        raise NotImplementedError

    def goal(self, rows: Rows) -> BoolArray:
        """Whether the task is done."""
        raise NotImplementedError

    def nominal_options(self) -> tuple[Option, ...]:
        """The nominal chain."""
        raise NotImplementedError

    def rows(
        self,
        qpos: Array,
        noise: Array,
        *,
        model: IntArray | None = None,
        furniture: Mapping[str, Array] | None = None,
        memory: Array | None = None,
    ) -> Rows:
        """Rows at rest, the impedance target at the grip site, fingers as `qpos` has them.

        Args:
            qpos: [N, nq] joint positions in the model's order.
            noise: [N, K, E] of the estimator.
            model: [N] model of each row; 0 without it.
            furniture: poses [N, 7] by body name.
            memory: [N, M]; zeros without it.
        """
        count = len(qpos)
        index = np.zeros(count, dtype=np.int64) if model is None else np.asarray(model, dtype=np.int64)
        down = np.tile([0.0, 1.0, 0.0, 0.0], (count, 1))
        states = self.engine.states_from(qpos, np.zeros((count, 3)), down, furniture)
        control = np.zeros((count, len(self.engine.control_names)))
        place = self.engine.physics_size
        sensors = self.engine.sense(states, control, index)
        states[:, place : place + 3] = sensors[:, self.engine.sensor_columns["grip_pos"]]
        states[:, place + 3 : place + 7] = sensors[:, self.engine.sensor_columns["grip_quat"]]
        memory = np.zeros((count, self.memory_size)) if memory is None else memory
        return Rows(states, sensors, index, noise, np.zeros(count, dtype=np.int64), memory, np.zeros(count))

    def read(self, rows: Rows, sensor: str) -> Array:
        """[N, d] last values of a sensor, e.g. `grip_pos` (world frame, m).

        Raises:
            ConfigError: no such sensor.
        """
        if sensor not in self.engine.sensor_columns:
            raise ConfigError(f"{self.name}: no sensor '{sensor}'; sensors: {', '.join(self.engine.sensor_columns)}")
        return rows.sensors[:, self.engine.sensor_columns[sensor]]

    def joint(self, rows: Rows, name: str) -> Array:
        """[N] position of a hinge or slide joint, rad or m.

        Raises:
            ConfigError: no such joint, or one whose position is more than a number (a free one has seven).
        """
        if name not in self._single:
            known = ", ".join(sorted(self._single)) or "none"
            if name in self._columns:
                raise ConfigError(
                    f"{self.name}: joint '{name}' is free or a ball, its position is no number; read a pose instead, "
                    f"`self.read(rows, <sensor>)` with sensors {', '.join(self.engine.sensor_columns)} "
                    "(`Parts.pose_sensors` adds one)"
                )
            raise ConfigError(f"{self.name}: no hinge or slide joint '{name}'; there are: {known}")
        return rows.states[:, self._columns[name]]

    def target(self, rows: Rows) -> Array:
        """[N, 7] pose of the impedance target, world frame: position in m, quaternion (w, x, y, z)."""
        return rows.states[:, self.engine.physics_size : self.engine.physics_size + 7]

    def arm(self, rows: Rows) -> Array:
        """[N, J] joint angles of the arm, rad."""
        return rows.states[:, self._arm]

    def furniture(self, rows: Rows, name: str) -> Array:
        """[N, 7] pose of a piece of furniture, world frame: position in m, quaternion (w, x, y, z)."""
        start = self.engine.physics_size + 7 * (1 + self.engine.furniture.index(name))
        return rows.states[:, start : start + 7]

    def gap_m(self, rows: Rows) -> Array:
        """[N] opening between the fingers, m."""
        return np.asarray(np.abs(rows.states[:, self._finger_columns]).sum(axis=1))

    def peak_force_n(self, chunk: Chunk, sensor: str) -> Array:
        """[N] largest norm of a force sensor during a control step, N."""
        return np.asarray(np.linalg.norm(self.engine.sensor(chunk, sensor), axis=2).max(axis=1))

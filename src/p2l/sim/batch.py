"""The batched engine: N states advance together through `mujoco.rollout`, one control step at a time.

State in, state out: a row of `states` holds everything that decides its future (the full physics state, the pose of
the impedance target and the poses of the furniture), so restoring a moment is handing its row back. Every call covers
exactly one control step because `rollout` starts each call with a cold solver; with that rule any way to cut an
episode gives the same trace to the bit, alone or in a batch, on any number of threads.

Axis letters: N rows, S state columns, T physics steps in a control step, U controls, D sensor values.
A row of `states`: full physics state, impedance target (position 3, quaternion 4), then 7 for each piece of furniture
in the order of `furniture`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import TracebackType

import mujoco
import numpy as np
import numpy.typing as npt
from mujoco import rollout

from p2l.errors import ConfigError, ShapeError
from p2l.records import Array, BoolArray, IntArray
from p2l.sim.model import AXES, TARGET_BODY

_PHYSICS = mujoco.mjtState.mjSTATE_FULLPHYSICS
_PLACES = ("pathadr", "npaths", "nbuffer")  # numbers of a model that depend on the place of its files
_INPUT = int(mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_MOCAP_POS | mujoco.mjtState.mjSTATE_MOCAP_QUAT)


@dataclass(frozen=True)
class Chunk:
    """One control step of N rows.

    Attributes:
        states: [N, S] at the end of the step.
        sensors: [N, T, D] at every physics step (MuJoCo senses a step's start, so they lag the state by one step).
        diverged: [N] rows in which MuJoCo gave up (NaN, or numbers out of bounds); their values mean nothing.
    """

    states: Array
    sensors: Array
    diverged: BoolArray


class Engine:
    """Steps batches of states; rows may use different models of one size.

    It remembers the models, the threads and scratch memory, never a state.

    Args:
        models: interchangeable models (same sizes and names), with `sim.model.add_impedance` applied.
        control_period_s: duration of a control step; a whole number of physics steps.
        nthread: simulator threads.

    Raises:
        ConfigError: no model, unlike models, no impedance target, or a period that is no multiple of the time step.
    """

    def __init__(self, models: Sequence[mujoco.MjModel], *, control_period_s: float, nthread: int = 2) -> None:
        if not models:
            raise ConfigError("engine: needs at least one model")
        first = models[0]
        steps = control_period_s / first.opt.timestep
        if round(steps) < 1 or abs(steps - round(steps)) > 1e-6:
            raise ConfigError(f"engine: control period {control_period_s} s is no multiple of {first.opt.timestep} s")
        for index, model in enumerate(models):
            same = (model.nq, model.nv, model.nu, model.nmocap, model.nsensordata, model.opt.timestep)
            if same != (first.nq, first.nv, first.nu, first.nmocap, first.nsensordata, first.opt.timestep):
                raise ConfigError(f"engine: model {index} has other sizes than model 0; rows of a batch must be alike")
        if mujoco.mj_name2id(first, mujoco.mjtObj.mjOBJ_BODY, TARGET_BODY) < 0:
            raise ConfigError("engine: the models have no impedance target; call add_impedance first")
        mocaps = {int(first.body(i).mocapid[0]): first.body(i).name for i in range(first.nbody)}
        self._target = int(first.body(TARGET_BODY).mocapid[0])
        self._order = [self._target, *(i for i in range(first.nmocap) if i != self._target)]
        self.furniture = tuple(mocaps[i] for i in self._order[1:])
        self.models = tuple(models)
        self.physics_steps = round(steps)
        self.timestep_s = float(first.opt.timestep)
        self.control_period_s = control_period_s
        self.physics_size = int(mujoco.mj_stateSize(first, _PHYSICS))
        self.state_size = self.physics_size + 7 * first.nmocap
        self.control_names = tuple(first.actuator(i).name for i in range(first.nu))
        self.sensor_columns = _sensor_columns(first)
        self.nq, self.nv = int(first.nq), int(first.nv)
        self._sensor_size = int(first.nsensordata)
        self._pool = rollout.Rollout(nthread=nthread)
        self._data = [mujoco.MjData(first) for _ in range(max(1, nthread))]

    def __enter__(self) -> Engine:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Stop the threads."""
        self._pool.close()

    def fingerprint(self) -> str:
        """Hash of every number of the models, to seven digits: processors differ in the last bits.

        Not of where the files of meshes lay, nor of how much memory their names take.
        """
        digest = hashlib.blake2b(digest_size=8)
        for model in self.models:
            for part in (model, model.opt):
                own = [each for each in dir(part) if not each.startswith("_") and not each.endswith(_PLACES)]
                for name in sorted(own):
                    value = getattr(part, name)
                    if isinstance(value, (np.ndarray, int, float)):
                        numbers = np.asarray(value)
                        single = numbers.astype(np.float32) if numbers.dtype.kind == "f" else numbers
                        digest.update(f"{name}:{single.dtype.str}:{single.shape}".encode() + single.tobytes())
        return digest.hexdigest()

    def states_from(
        self,
        qpos: npt.ArrayLike,
        target_pos: npt.ArrayLike,
        target_quat: npt.ArrayLike,
        furniture: Mapping[str, Array] | None = None,
    ) -> Array:
        """Rows at rest: [N, S] from joint positions [N, nq] and target poses [N, 3] m, [N, 4] (w, x, y, z).

        Args:
            qpos: [N, nq] joint positions in the order of the model.
            target_pos: [N, 3] of the impedance target, world frame, m.
            target_quat: [N, 4] of the impedance target, (w, x, y, z).
            furniture: poses [N, 7] (position in m, quaternion) by body name; the model's own pose where one is missing.

        Raises:
            ConfigError: a piece of furniture that the model does not have.
        """
        positions = np.atleast_2d(np.asarray(qpos, dtype=np.float64))
        states = np.zeros((len(positions), self.state_size))
        states[:, 1 : 1 + self.nq] = positions
        states[:, self.physics_size : self.physics_size + 3] = target_pos
        states[:, self.physics_size + 3 : self.physics_size + 7] = target_quat
        poses = dict(furniture or {})
        if unknown := sorted(set(poses) - set(self.furniture)):
            raise ConfigError(f"engine: no furniture {unknown}; the model has: {', '.join(self.furniture) or 'none'}")
        for place, name in enumerate(self.furniture, start=1):
            body = self.models[0].body(name)
            pose = poses.get(name, np.concatenate([body.pos, body.quat]))
            states[:, self.physics_size + 7 * place : self.physics_size + 7 * place + 7] = pose
        return states

    def qpos(self, states: Array) -> Array:
        """[N, nq] joint positions."""
        return states[:, 1 : 1 + self.nq]

    def qvel(self, states: Array) -> Array:
        """[N, nv] joint velocities."""
        return states[:, 1 + self.nq : 1 + self.nq + self.nv]

    def target_pos(self, states: Array) -> Array:
        """[N, 3] where the impedance target stands, world frame, m."""
        return states[:, self.physics_size : self.physics_size + 3]

    def step(
        self, states: Array, target_pos: Array, target_quat: Array, control: Array, model_index: IntArray
    ) -> Chunk:
        """Advance every row by one control step.

        Args:
            states: [N, S].
            target_pos: [N, 3] world frame, m; the target moves there linearly during the step.
            target_quat: [N, 4] unit quaternions (w, x, y, z), reached by normalised interpolation.
            control: [N, U] in the order of `control_names` (stiffnesses first where the scene has no others).
            model_index: [N] which model each row uses.

        Raises:
            ShapeError: an input has another shape, or holds NaN.
        """
        self._check(states, target_pos, target_quat, control, model_index)
        before = states[:, self.physics_size : self.physics_size + 7]
        sign = np.where((before[:, 3:] * target_quat).sum(1, keepdims=True) < 0.0, -1.0, 1.0)
        after = np.concatenate([target_pos, sign * target_quat], axis=1)
        fraction = (np.arange(1, self.physics_steps + 1) / self.physics_steps)[None, :, None]
        target = before[:, None] * (1.0 - fraction) + after[:, None] * fraction
        target[..., 3:] /= np.linalg.norm(target[..., 3:], axis=-1, keepdims=True)
        path, sensors = self._roll(states, target, control, model_index)
        end_states = np.concatenate([path[:, -1], target[:, -1], states[:, self.physics_size + 7 :]], axis=1)
        # After a MuJoCo warning `rollout` repeats the last state, so the clock stands still or values are not finite.
        due = states[:, 0] + (self.physics_steps - 0.5) * self.timestep_s
        diverged = ~np.isfinite(path[:, -1]).all(axis=1) | (path[:, -1, 0] < due)
        return Chunk(states=end_states, sensors=sensors, diverged=diverged)

    def sense(self, states: Array, control: Array, model_index: IntArray) -> Array:
        """[N, D] what the sensors read in these states, before any step; arguments as in `step`."""
        pose = states[:, self.physics_size : self.physics_size + 7]
        self._check(states, pose[:, :3], pose[:, 3:], control, model_index)
        _, sensors = self._roll(states, pose[:, None], control, model_index)
        return np.asarray(sensors[:, 0])

    def _roll(self, states: Array, target: Array, control: Array, model_index: IntArray) -> tuple[Array, Array]:
        """Physics states [N, T, ·] and sensors [N, T, D] while the impedance target follows `target` [N, T, 7]."""
        rows, steps = target.shape[:2]
        units, mocaps = len(self.control_names), len(self._order)
        inputs = np.empty((rows, steps, units + 7 * mocaps))
        inputs[..., :units] = control[:, None]
        for place, mocap in enumerate(self._order):
            start = self.physics_size + 7 * place
            pose = target if place == 0 else states[:, None, start : start + 7]
            inputs[..., units + 3 * mocap : units + 3 * mocap + 3] = pose[..., :3]
            quats = units + 3 * mocaps + 4 * mocap
            inputs[..., quats : quats + 4] = pose[..., 3:]
        models = [self.models[index] for index in model_index.tolist()]
        physics = np.ascontiguousarray(states[:, : self.physics_size])
        path = np.empty((rows, steps, self.physics_size))
        sensors = np.empty((rows, steps, self._sensor_size))
        if not rows:  # MuJoCo's rollout would end the process
            return path, sensors
        self._pool.rollout(
            models,
            self._data,
            physics,
            inputs,
            control_spec=_INPUT,
            skip_checks=True,  # `_check` has tested the shapes; rollout's own check of every row's model costs a tenth
            nstep=steps,
            state=path,
            sensordata=sensors,
        )
        return path, sensors

    @cached_property
    def impedance_columns(self) -> list[int]:
        """[6] columns of the controls that are stiffnesses, along and about each axis."""
        return [self.control_names.index(f"impedance_{label}") for label in AXES]

    def stiffness(self, rows: int, linear: npt.ArrayLike, angular: npt.ArrayLike) -> Array:
        """[N, U] controls with these stiffnesses (N/m, N·m/rad; numbers or [N]) and zeros elsewhere."""
        control = np.zeros((rows, len(self.control_names)))
        for axis, column in enumerate(self.impedance_columns):
            control[:, column] = linear if axis < 3 else angular
        return control

    def sensor(self, chunk: Chunk, name: str) -> Array:
        """[N, T, d] values of one named sensor.

        Raises:
            ConfigError: no such sensor.
        """
        if name not in self.sensor_columns:
            raise ConfigError(f"engine: no sensor '{name}'; sensors: {', '.join(self.sensor_columns) or 'none'}")
        return chunk.sensors[..., self.sensor_columns[name]]

    def _check(self, states: Array, pos: Array, quat: Array, control: Array, index: IntArray) -> None:
        rows = len(states)
        inputs = {
            "states": (states, (rows, self.state_size)),
            "target_pos": (pos, (rows, 3)),
            "target_quat": (quat, (rows, 4)),
            "control": (control, (rows, len(self.control_names))),
            "model_index": (index, (rows,)),
        }
        for name, (array, shape) in inputs.items():
            if array.shape != shape:
                raise ShapeError(f"engine.step: {name} has shape {array.shape}; expected {shape}")
        for name in ("states", "target_pos", "target_quat", "control"):
            if not np.isfinite(inputs[name][0]).all():
                raise ShapeError(f"engine.step: {name} holds NaN or infinity")


def _sensor_columns(model: mujoco.MjModel) -> dict[str, slice]:
    return {
        model.sensor(i).name: slice(int(model.sensor_adr[i]), int(model.sensor_adr[i] + model.sensor_dim[i]))
        for i in range(model.nsensor)
    }

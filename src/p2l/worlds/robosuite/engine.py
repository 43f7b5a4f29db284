"""An engine whose physics and control are robosuite's: a control step of a row is one `env.step`.

The command of our engine (target pose, fingers) becomes one action: the target's position and rotation vector for
OSC_POSE, ±1 for the gripper. A row that is not where the last step ended is loaded first. The wrist's force is recorded
at every physics step by an observable, robosuite's own way of adding a sensor; every other sensor is read at the end.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from p2l.errors import ConfigError
from p2l.records import Array, IntArray
from p2l.sim.batch import Chunk, Engine
from p2l.sim.scene import WRIST_FORCE, Scene
from p2l.worlds.robosuite.mirror import Mirror


class RobosuiteEngine(Engine):
    """One row at a time through one robosuite environment.

    Args:
        environment: robosuite's; its Observables gain one.
        engine: ours, whose columns rows and sensors have.
        scene: what the engine was made of.
    """

    def __init__(self, environment: Any, engine: Engine, scene: Scene) -> None:
        super().__init__(engine.models, control_period_s=engine.control_period_s, nthread=1)
        self.environment = environment
        self._mirror = Mirror(environment, engine, scene.arm_joints)
        actuator, (open_control, closed_control) = next(iter(scene.fingers.items()))
        self._finger = self.control_names.index(actuator)
        self._open_control, self._closed_control = open_control, closed_control
        self._last_state: Array | None = None
        self._force: list[Array] = []
        self._record_force()

    def close(self) -> None:
        """Close the environment."""
        super().close()
        self.environment.close()

    def step(
        self, states: Array, target_pos: Array, target_quat: Array, control: Array, model_index: IntArray
    ) -> Chunk:
        """One control step of one row; see `Engine.step`.

        Raises:
            ConfigError: more than one row.
            ShapeError: an input has another shape, or holds NaN.
        """
        self._check(states, target_pos, target_quat, control, model_index)
        close_command = self._close_command(control)
        if self._last_state is None or not np.array_equal(self._last_state, states[0]):
            self._mirror.load(states[0], close_command=close_command, model=int(model_index[0]))
        turn = Rotation.from_quat(target_quat[0], scalar_first=True).as_rotvec()
        self._force.clear()
        self.environment.step(np.concatenate([target_pos[0], turn, [1.0 if close_command else -1.0]]))
        target = np.concatenate([target_pos[0], target_quat[0]])
        state = self._mirror.state(target, states[0, self.physics_size + 7 :])
        self._last_state = state.copy()
        return Chunk(state[None], self._trace()[None], np.array([not np.isfinite(state).all()]))

    def sense(self, states: Array, control: Array, model_index: IntArray) -> Array:
        """[1, D] what our sensors would read in robosuite at this row, which is loaded; see `Engine.sense`."""
        pose = states[:, self.physics_size : self.physics_size + 7]
        self._check(states, pose[:, :3], pose[:, 3:], control, model_index)
        self._mirror.load(states[0], close_command=self._close_command(control), model=int(model_index[0]))
        self._last_state = None
        return self._mirror.sensors()[None]

    def _check(self, states: Array, pos: Array, quat: Array, control: Array, index: IntArray) -> None:
        super()._check(states, pos, quat, control, index)
        if len(states) != 1:
            raise ConfigError(f"robosuite runs one row at a time, got {len(states)}; use one slot")

    def _close_command(self, control: Array) -> bool:
        return bool((control[0, self._finger] - self._open_control) / (self._closed_control - self._open_control) > 0.5)

    def success(self) -> bool:
        """What robosuite's own test says of the state it is in."""
        return bool(self.environment._check_success())

    def _trace(self) -> Array:
        """[T, D] sensors of the control step."""
        trace = np.repeat(self._mirror.sensors()[None], len(self._force), axis=0)
        trace[:, self.sensor_columns[WRIST_FORCE]] = np.array(self._force)
        return trace

    def _record_force(self) -> None:
        from robosuite.utils.observables import Observable, sensor

        @sensor(modality="wrist")
        def wrist_force(_: Any) -> Array:
            force = self._mirror.raw(WRIST_FORCE)
            self._force.append(force)
            return force

        rate = 1.0 / self.environment.model_timestep
        self.environment.add_observable(Observable("wrist_force_trace", wrist_force, sampling_rate=rate, active=False))

"""Our row of robosuite's simulation, and robosuite's simulation at our row: the same joints, bodies and sites by name.

What is set of a row: positions and velocities of all joints that both have, and where furniture stands (robosuite's
Door sets its body's pose at a reset in the same way). Where our world has several models, masses and sizes of what is
not fixed are set to those of the row's. The arm's posture is given to the robot as its `init_qpos` before
robosuite's own reset, so that its controller takes it as its rest posture. Objects that only robosuite has stay where
its reset puts them (out of sight).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np

from p2l.errors import ConfigError
from p2l.records import Array, IntArray
from p2l.sim.batch import Engine

_BODY, _SITE = int(mujoco.mjtObj.mjOBJ_XBODY), int(mujoco.mjtObj.mjOBJ_SITE)
_POS, _QUAT = int(mujoco.mjtSensor.mjSENS_FRAMEPOS), int(mujoco.mjtSensor.mjSENS_FRAMEQUAT)
Reading = Callable[[], Array]


class Mirror:
    """Between one robosuite environment and rows of our engine.

    Args:
        environment: robosuite's.
        engine: whose rows and sensors are meant.
        arm_joints: names of the arm's joints, in order.
    """

    def __init__(self, environment: Any, engine: Engine, arm_joints: Sequence[str]) -> None:
        self._environment, self._engine = environment, engine
        sim, model = environment.sim, engine.models[0]
        joints = [model.joint(i) for i in range(model.njnt)]
        qpos_there = [sim.model.get_joint_qpos_addr(joint.name) for joint in joints]
        qvel_there = [sim.model.get_joint_qvel_addr(joint.name) for joint in joints]
        self._qpos = _pairs([(int(joint.qposadr[0]), len(joint.qpos0)) for joint in joints], qpos_there)
        self._qvel = _pairs([(int(joint.dofadr[0]), len(joint.damping)) for joint in joints], qvel_there)
        self._arm = [int(model.joint(name).qposadr[0]) for name in arm_joints]
        self._furniture = [sim.model.body_name2id(name) for name in engine.furniture]
        self._shape: int | None = 0 if len(engine.models) == 1 else None  # which of our models robosuite has
        self._readings = [self._reading(i) for i in range(model.nsensor)]

    def load(self, state: Array, *, close_command: bool, model: int = 0) -> None:
        """Put robosuite at a row [S] of a model, at the start of a control step, the fingers with their command."""
        self._reshape(model)
        qpos, qvel = self._engine.qpos(state[None])[0], self._engine.qvel(state[None])[0]
        robot = self._environment.robots[0]
        robot.init_qpos = qpos[self._arm]
        self._environment.reset()
        sim = self._environment.sim
        for place, body in enumerate(self._furniture, start=1):
            at = self._engine.physics_size + 7 * place
            sim.model.body_pos[body], sim.model.body_quat[body] = state[at : at + 3], state[at + 3 : at + 7]
        sim.data.qpos[self._qpos[1]] = qpos[self._qpos[0]]
        sim.data.qvel[self._qvel[1]] = qvel[self._qvel[0]]
        sim.forward()
        robot.composite_controller.update_state()
        for part in robot.composite_controller.part_controllers.values():
            part.update(force=True)
            part.reset_goal()
        for gripper in robot.gripper.values():
            gripper.current_action = np.array([-1.0, 1.0]) if close_command else np.array([1.0, -1.0])

    def _reshape(self, index: int) -> None:
        """Give free bodies the masses and sizes that they have in one of our models."""
        if index == self._shape:
            return
        ours, sim = self._engine.models[index], self._environment.sim
        free = {int(ours.jnt_bodyid[i]) for i in np.flatnonzero(ours.jnt_type == mujoco.mjtJoint.mjJNT_FREE)}
        for body in free:
            there = sim.model.body_name2id(ours.body(body).name)
            sim.model.body_mass[there], sim.model.body_inertia[there] = ours.body_mass[body], ours.body_inertia[body]
        for geom in (i for i in range(ours.ngeom) if int(ours.geom_bodyid[i]) in free):
            sim.model.geom_size[sim.model.geom_name2id(ours.geom(geom).name)] = ours.geom_size[geom]
        mujoco.mj_setConst(sim.model._model, sim.data._data)
        self._shape = index

    def state(self, target: Array, furniture: Array) -> Array:
        """[S] our row of robosuite's present state.

        Args:
            target: [7] where the target stands, position (m) and quaternion.
            furniture: the rest of a row, as in our engine.
        """
        data, engine = self._environment.sim.data, self._engine
        state = np.zeros(engine.state_size)
        state[0] = data.time
        state[1 + self._qpos[0]] = data.qpos[self._qpos[1]]
        state[1 + engine.nq + self._qvel[0]] = data.qvel[self._qvel[1]]
        state[engine.physics_size :] = np.concatenate([target, furniture])
        return state

    def sensors(self) -> Array:
        """[D] what our sensors would read in robosuite's present state."""
        return np.concatenate([reading() for reading in self._readings])

    def _reading(self, index: int) -> Reading:
        model, data = self._engine.models[0], self._environment.sim.data
        kind, on = int(model.sensor_type[index]), int(model.sensor_objtype[index])
        name = mujoco.mj_id2name(model, on, int(model.sensor_objid[index]))
        readings: dict[tuple[int, int], Reading] = {
            (_POS, _SITE): lambda: np.array(data.get_site_xpos(name)),
            (_POS, _BODY): lambda: np.array(data.get_body_xpos(name)),
            (_QUAT, _SITE): lambda: self._site_quat(name),
            (_QUAT, _BODY): lambda: np.array(data.get_body_xquat(name)),
        }
        label = model.sensor(index).name
        return readings.get((kind, on), lambda: np.array(self.raw(label)))

    def _site_quat(self, name: str) -> Array:
        """[4] orientation of a site with the sign that MuJoCo's own sensor gives: that of its body, by the joints.

        A rotation matrix has lost the sign; where w is about 0, as of a hand that points down, any other choice of it
        makes the reading jump from q to −q, and policies take one for the other's opposite.
        """
        model, data = self._environment.sim.model._model, self._environment.sim.data
        site, quat = model.site(name), np.zeros(4)
        body = model.body(int(site.bodyid[0])).name
        mujoco.mju_mulQuat(quat, np.array(data.get_body_xquat(body)), site.quat)
        return quat

    def raw(self, sensor: str) -> Array:
        """[d] present value of a sensor that robosuite has itself.

        Raises:
            ConfigError: it has none of that name.
        """
        sim = self._environment.sim
        names = sim.model.sensor_names
        if sensor not in names:
            raise ConfigError(f"robosuite's environment has no sensor '{sensor}'; it has: {', '.join(names)}")
        index = sim.model.sensor_name2id(sensor)
        at = int(sim.model.sensor_adr[index])
        return np.array(sim.data.sensordata[at : at + int(sim.model.sensor_dim[index])])


def _pairs(ours: Sequence[tuple[int, int]], there: Sequence[int | tuple[int, int]]) -> tuple[IntArray, IntArray]:
    """Indices here and there of joints with (address, size) here and robosuite's address or range there."""
    first = [int(at[0]) if isinstance(at, tuple) else int(at) for at in there]
    here = np.concatenate([np.arange(at, at + size) for at, size in ours])
    return here, np.concatenate([np.arange(at, at + size) for at, (_, size) in zip(first, ours, strict=True)])

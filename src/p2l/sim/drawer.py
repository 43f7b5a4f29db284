"""Draws states of one model off screen; who calls has made a GL context current.

Axis letters: S state columns, H and W pixels.
"""

from __future__ import annotations

import copy

import mujoco
import numpy as np
import numpy.typing as npt

from p2l.records import Array
from p2l.sim.batch import Engine
from p2l.sim.model import TARGET_BODY


class Drawer:
    """One model with what the GL needs of it; close it before the context.

    Args:
        engine: whose states are drawn.
        model: one of its models with visual geoms.
        width, height: of the pictures, pixels.
        samples: of a pixel, against ragged edges.
    """

    def __init__(self, engine: Engine, model: mujoco.MjModel, width: int, height: int, samples: int) -> None:
        self._engine = engine
        self._model = copy.copy(model)
        self._model.vis.quality.shadowsize = 1024
        self._model.vis.quality.offsamples = samples
        self._data = mujoco.MjData(self._model)
        self._scene_option = mujoco.MjvOption()
        self._scene_option.geomgroup[:] = 0
        # robosuite's collision geoms are group 0 and would hide the visual ones, which are group 1.
        self._scene_option.geomgroup[1 if (self._model.geom_group == 1).any() else 0] = 1
        self._scene_option.sitegroup[:] = 0
        self._scene = mujoco.MjvScene(self._model, maxgeom=2000)
        self._target = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        self._rect = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._target)

    def close(self) -> None:
        """Give back what the GL holds."""
        self._target.free()

    def draw(
        self, state: Array, lookat_m: Array, azimuth_deg: float, elevation_deg: float, distance_m: float
    ) -> npt.NDArray[np.uint8]:
        """[H, W, 3] a state [S] of the engine, seen from `distance_m` towards `lookat_m` [3], world frame."""
        self._pose(state)
        camera = mujoco.MjvCamera()
        camera.lookat[:] = lookat_m
        camera.azimuth, camera.elevation, camera.distance = azimuth_deg, elevation_deg, distance_m
        every = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self._model, self._data, self._scene_option, None, camera, every, self._scene)
        mujoco.mjr_render(self._rect, self._scene, self._target)
        pixels = np.empty((self._rect.height, self._rect.width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(pixels, None, self._rect, self._target)
        return pixels[::-1]

    def _pose(self, state: Array) -> None:
        """Put the model where a row of the engine has it."""
        engine, size = self._engine, self._engine.physics_size
        mujoco.mj_setState(self._model, self._data, state[:size], mujoco.mjtState.mjSTATE_FULLPHYSICS)
        for place, name in enumerate((TARGET_BODY, *engine.furniture)):
            mocap = int(self._model.body(name).mocapid[0])
            pose = state[size + 7 * place : size + 7 * place + 7]
            self._data.mocap_pos[mocap], self._data.mocap_quat[mocap] = pose[:3], pose[3:]
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)

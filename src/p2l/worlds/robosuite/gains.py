"""Gains with which robosuite's OSC feels like the impedance of a skill.

A skill is a motion with a fixed impedance (thesis, sections 3.5 and 5.4), a stiffness K and a damping D. OSC multiplies
both its terms with the inertia Λ that the hand has at the moment: stiffness kp · Λ, damping 2 · ratio · √kp · Λ, so
they change with the posture and the direction. `impedance_gains` are the kp and ratio that give K and D for the
geometric mean of Λ over the directions, at a start posture; robosuite's own choice is 150 and 1 for everything.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from p2l.errors import ConfigError
from p2l.records import Array
from p2l.sim.scene import GRIP_SITE, Scene


@dataclass(frozen=True)
class Gains:
    """Settings of OSC_POSE for three directions and three axes.

    Attributes:
        kp: [6] stiffness per inertia, 1/s².
        damping_ratio: [6] 1 = critically damped.
    """

    kp: tuple[float, ...] = (150.0,) * 6
    damping_ratio: tuple[float, ...] = (1.0,) * 6


def impedance_gains(scene: Scene, qpos: Array) -> Gains:
    """The gains that feel like the scene's impedance at joint positions `qpos` [nq].

    Raises:
        ConfigError: that impedance is stiffer along some axes of the hand; OSC's are those of the world.
    """
    physics = scene.physics
    if set(physics.axis_scale) != {1.0}:
        raise ConfigError("no gains of OSC_POSE match an impedance with axis_scale; leave it at 1, or name the gains")
    stiffness = np.repeat([physics.stiffness_linear, physics.stiffness_angular], 3)
    damping = np.repeat([physics.damping_linear, physics.damping_angular], 3)
    mean = np.repeat([np.linalg.det(part) ** (1.0 / 3.0) for part in inertia(scene, qpos)], 3)
    ratio = damping / (2.0 * np.sqrt(stiffness * mean))
    return Gains(tuple((stiffness / mean).tolist()), tuple(ratio.tolist()))


def inertia(scene: Scene, qpos: Array) -> tuple[Array, Array]:
    """What the hand resists accelerations with: [3, 3] kg, and [3, 3] kg·m² about its axes."""
    model = scene.model
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    jacobian, mass = np.zeros((6, model.nv)), np.zeros((model.nv, model.nv))
    mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], model.site(GRIP_SITE).id)
    mujoco.mj_fullM(model, mass, data.qM)
    dofs = [int(model.joint(joint).dofadr[0]) for joint in scene.arm_joints]
    inverse = np.linalg.inv(mass[np.ix_(dofs, dofs)])
    position, orientation = jacobian[:3, dofs], jacobian[3:, dofs]
    return np.linalg.inv(position @ inverse @ position.T), np.linalg.inv(orientation @ inverse @ orientation.T)

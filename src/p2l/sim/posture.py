"""Postures of an arm that put its grip site at a pose: where executions start, and whether a pose is in reach.

Inverse kinematics is mink's; this module freezes everything but the arm and tries many start postures, because a
step of differential kinematics does not leave the branch (elbow, wrist flip) that it starts in.
"""

from __future__ import annotations

from collections.abc import Sequence

import mink
import numpy as np
from scipy.stats import qmc

from p2l.records import Array
from p2l.sim.scene import GRIP_SITE, Scene

_STEP_S = 0.1
_ITERATIONS = 60


def reach(
    scene: Scene,
    pos_world: Array,
    quat_world: Array,
    *,
    starts: Sequence[Array] = (),
    restarts: int = 24,
    tolerance_m: float = 1e-3,
    tolerance_rad: float = 1e-2,
) -> Array | None:
    """[J] joint angles of the arm, rad, with the grip site at a pose, or None where no posture reaches it.

    Of several postures it returns the one that stays farthest from the joint limits.

    Args:
        scene: with the arm.
        pos_world: [3] m.
        quat_world: [4] (w, x, y, z).
        starts: postures [J] to try beside the arm's home; the first that leads there is returned at once.
        restarts: further starts, spread evenly over the joints' ranges.
        tolerance_m: what counts as reached.
        tolerance_rad: the same for the orientation.
    """
    task = mink.FrameTask(GRIP_SITE, "site", position_cost=1.0, orientation_cost=0.3, lm_damping=1e-3)
    task.set_target(mink.SE3.from_rotation_and_translation(mink.SO3(np.asarray(quat_world)), np.asarray(pos_world)))
    for start in starts:
        if (posture := _solve(scene, task, start, tolerance_m, tolerance_rad)) is not None:
            return posture
    low, high = np.array([scene.model.joint(name).range for name in scene.arm_joints]).T
    spread = qmc.Halton(len(low), scramble=False).random(restarts + 1)[1:]
    candidates = [scene.home, *(low + (high - low) * (0.1 + 0.8 * spread))]
    solutions = [_solve(scene, task, start, tolerance_m, tolerance_rad) for start in candidates]
    postures = [posture for posture in solutions if posture is not None]
    if not postures:
        return None
    return max(postures, key=lambda q: float((np.minimum(q - low, high - q) / (high - low)).min()))


def _solve(scene: Scene, task: mink.FrameTask, start: Array, tolerance_m: float, tolerance_rad: float) -> Array | None:
    model = scene.model
    addresses = [int(model.joint(name).qposadr[0]) for name in scene.arm_joints]
    dofs = [int(model.joint(name).dofadr[0]) for name in scene.arm_joints]
    other_dofs = [dof for dof in range(model.nv) if dof not in dofs]
    limits = [mink.ConfigurationLimit(model)]
    configuration = mink.Configuration(model)
    q = configuration.q.copy()
    q[addresses] = start
    configuration.update(q)
    for _ in range(_ITERATIONS):
        error = task.compute_error(configuration)
        if np.linalg.norm(error[:3]) < tolerance_m and np.linalg.norm(error[3:]) < tolerance_rad:
            return np.array(configuration.q[addresses])
        velocity = mink.solve_ik(configuration, [task], _STEP_S, "quadprog", damping=1e-6, limits=limits)
        velocity[other_dofs] = 0.0
        configuration.integrate_inplace(velocity, _STEP_S)
    return None

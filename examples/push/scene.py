"""A table top, a block, and a ball-shaped hand that follows the impedance target; there is no arm."""

from __future__ import annotations

import mujoco

HALF_BLOCK_M = 0.03


def spec() -> mujoco.MjSpec:
    """The scene, in MuJoCo's own terms."""
    scene = mujoco.MjSpec()
    scene.worldbody.add_light(pos=[0.0, 0.0, 1.0])
    scene.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.5, 0.5, 0.1])
    block = scene.worldbody.add_body(name="block", pos=[0.0, 0.0, HALF_BLOCK_M])
    block.add_freejoint(name="block")
    block.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[HALF_BLOCK_M] * 3, mass=0.2)
    hand = scene.worldbody.add_body(name="hand", pos=[-0.1, 0.0, HALF_BLOCK_M], gravcomp=1.0)
    hand.add_freejoint(name="hand")
    hand.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.015, 0.0, 0.0], mass=0.2)
    hand.add_site(name="hand")
    return scene

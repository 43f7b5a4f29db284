"""The doors of table 4.2: five levers from thick to thin and short, and a full-sized door with a slippery cylinder.

`real` is the first of them with the joints of the author's scene: a closer shuts the door, and a lever stays where it
was left, so that going back to the start does not find the world as it was.

A shape is an edit of robosuite's door before it is compiled; every shape leaves the model's sizes as they are, so rows
of one batch may have different handles.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np

from p2l import poses
from p2l.errors import ConfigError
from p2l.records import Array

DOOR = "Door"
HINGE_FROM_AXIS_M = 0.43  # robosuite's
GRASP_FROM_SITE_M = 0.045  # the nominal grasp, from the handle's position towards its axis
GRASP_DEEPER_M = 0.04  # and beyond the lever's middle: with the exact state the palm leans on the lever
LATCH_DAMPING_NMS = 0.2  # N·m·s/rad; without it a lever that is let go swings for four seconds
LATCH_FRICTION_NM = 0.1  # robosuite's
STIFF = [0.99, 0.99, 0.001, 0.5, 2.0]  # of dry friction: with MuJoCo's 0.9 a lever at rest creeps by 0.055 rad/s
LATER = {"latch_friction_nm": LATCH_FRICTION_NM, "latch_damping_nms": LATCH_DAMPING_NMS}
LEVER_OUT_M = 0.10  # robosuite's: from the door's middle plane to the middle of the lever
SITE_FROM_TIP_M = 0.025  # robosuite's: what counts as the handle's position lies that far from the tip


@dataclass(frozen=True)
class Handle:
    """One handle, and the door that it belongs to.

    Attributes:
        length_m: from the axis of rotation to the tip.
        thickness_m: across the lever, between the fingers.
        depth_m: along the approach.
        round: a cylinder along the lever (of diameter `thickness_m`) instead of a box.
        friction: sliding friction of the handle, whatever touches it; 1 is robosuite's own number for its lever.
        weight: mass and inertia of the door, as a multiple of robosuite's 2.4 kg.
        hinge_friction_nm: N·m that the hinge resists with.
        closer_nm_per_rad: stiffness of the spring that closes the door.
        latch_friction_nm: N·m that the lever's axis resists with; 0.1 is robosuite's. Its spring has 1 N·m/rad, so that
            with 1 N·m a lever stays where it was left.
        latch_damping_nms: N·m·s/rad of the lever's axis.
    """

    length_m: float
    thickness_m: float
    depth_m: float
    round: bool = False
    friction: float = 1.0
    weight: float = 1.0
    hinge_friction_nm: float = 0.0
    closer_nm_per_rad: float = 0.0
    latch_friction_nm: float = field(default=LATCH_FRICTION_NM, repr=False)
    latch_damping_nms: float = field(default=LATCH_DAMPING_NMS, repr=False)

    @property
    def identity(self) -> str:
        """What a world's digest knows of it: a handle as there was before there were `LATER` fields is the same one."""
        differing = {name: getattr(self, name) for name in LATER if getattr(self, name) != LATER[name]}
        return repr(self) + (str(differing) if differing else "")

    @property
    def site_m(self) -> float:
        """From the axis of rotation to the point that counts as the handle's position."""
        return self.length_m - SITE_FROM_TIP_M


HANDLES: Mapping[str, Handle] = {
    "1": Handle(0.150, 0.040, 0.030),
    "2": Handle(0.090, 0.030, 0.020),
    "3": Handle(0.150, 0.030, 0.030),
    "4": Handle(0.140, 0.026, 0.024),
    "5": Handle(0.095, 0.012, 0.012),
    "real": Handle(0.150, 0.040, 0.030, closer_nm_per_rad=20.0, latch_friction_nm=1.0, latch_damping_nms=0.0),
    "full_size": Handle(0.140, 0.030, 0.030, True, friction=0.4, weight=4.0, hinge_friction_nm=0.8),
}
NOMINAL = HANDLES["1"]


def find(names: str | int | Sequence[str | int]) -> tuple[Handle, ...]:
    """The handles of one name or of a list of names.

    Raises:
        ConfigError: an unknown one, or none.
    """
    keys = [names] if isinstance(names, str | int) else list(names)
    if unknown := [str(name) for name in keys if str(name) not in HANDLES]:
        raise ConfigError(f"door: unknown handle {', '.join(unknown)}; known handles: {', '.join(HANDLES)}")
    if not keys:
        raise ConfigError(f"door: handle is an empty list; known handles: {', '.join(HANDLES)}")
    return tuple(HANDLES[str(name)] for name in keys)


def shape(handle: Handle) -> Callable[[mujoco.MjSpec], None]:
    """The edit that gives robosuite's door this handle, in its collision geom and in its visual one."""

    def edit(spec: mujoco.MjSpec) -> None:
        for geom in spec.geoms:
            if geom.name in (f"{DOOR}_handle", f"{DOOR}_handle_visual"):
                _shape_geom(geom, handle)
        spec.site(f"{DOOR}_handle").pos = [handle.site_m, -LEVER_OUT_M, 0.0]
        panel = spec.body(f"{DOOR}_door")
        panel.mass *= handle.weight
        panel.inertia = handle.weight * panel.inertia
        hinge = spec.joint(f"{DOOR}_hinge")
        hinge.frictionloss = handle.hinge_friction_nm
        hinge.stiffness = [handle.closer_nm_per_rad, 0.0, 0.0]
        latch = spec.joint(f"{DOOR}_latch_joint")
        latch.damping = [handle.latch_damping_nms, 0.0, 0.0]
        latch.frictionloss = handle.latch_friction_nm
        if handle.latch_friction_nm != LATCH_FRICTION_NM:
            latch.solimp_friction = STIFF

    return edit


def _shape_geom(geom: mujoco.MjsGeom, handle: Handle) -> None:
    half = handle.length_m / 2
    geom.pos = [half, -LEVER_OUT_M, 0.0]
    geom.size = [half, handle.depth_m / 2, handle.thickness_m / 2]
    if handle.round:
        geom.type = mujoco.mjtGeom.mjGEOM_CYLINDER
        geom.size = [handle.thickness_m / 2, half, 0.0]
        geom.quat = [0.5**0.5, 0.0, 0.5**0.5, 0.0]
    geom.friction = [handle.friction, 0.005, 1e-4]
    geom.priority = 1  # without it the larger friction of the two decides, which is the pads'


def grasp_pose(handle_pos: Array, handle_quat: Array, finger_sign: float) -> tuple[Array, Array, Array]:
    """Where the nominal grasp holds a lever: position [N, 3], orientation [N, 4], and the way into the door [N, 3].

    Args:
        handle_pos: [N, 3] world frame, m.
        handle_quat: [N, 4] of the lever's frame: x from the axis to the tip, y into the door, z across.
        finger_sign: 1 or −1, which of the two equivalent ways round the fingers are.
    """
    lever = poses.rotation(handle_quat)
    into = poses.rotate(lever, [0.0, 1.0, 0.0])
    quat = poses.frame(poses.rotate(lever, [0.0, 0.0, finger_sign]), into)
    return handle_pos + poses.rotate(lever, [-GRASP_FROM_SITE_M, GRASP_DEEPER_M, 0.0]), quat, into


def axis_of(handle_pos: Array, handle_quat: Array) -> Array:
    """[N, 3] where the nominal handle's axis of rotation is, given its position and orientation; world frame, m."""
    return handle_pos - poses.rotate(poses.rotation(handle_quat), [NOMINAL.site_m, 0.0, 0.0])


def hinge_of(handle_pos: Array, handle_quat: Array) -> Array:
    """[N, 3] where the nominal door's hinge is, at the height of the handle's axis; world frame, m."""
    into = poses.rotate(poses.rotation(handle_quat), [0.0, 1.0, 0.0])
    return axis_of(handle_pos, handle_quat) + HINGE_FROM_AXIS_M * np.cross(into, [0.0, 0.0, 1.0]) + LEVER_OUT_M * into

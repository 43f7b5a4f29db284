"""Shapes of the door's handle: five levers from thick to thin and short, and a slippery cylinder (thesis, table 4.2).

A shape is an edit of robosuite's door before it is compiled; every shape leaves the model's sizes as they are, so rows
of one batch may have different handles.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import mujoco

from p2l.errors import ConfigError

DOOR = "Door"
LEVER_DEPTH_M = 0.10  # robosuite's: from the door's middle plane to the lever's axis
SITE_FROM_TIP_M = 0.025  # robosuite's: the point that counts as the handle's position lies that far from the tip


@dataclass(frozen=True)
class Handle:
    """One handle.

    Attributes:
        length_m: from the axis of rotation to the tip.
        thickness_m: across the lever, between the fingers.
        depth_m: along the approach.
        friction: sliding friction against whatever touches it; None keeps robosuite's (pads of 2 decide).
        round: a cylinder along the lever instead of a box.
    """

    length_m: float
    thickness_m: float
    depth_m: float
    friction: float | None = None
    round: bool = False

    @property
    def site_m(self) -> float:
        """From the axis of rotation to the point that counts as the handle's position."""
        return self.length_m - SITE_FROM_TIP_M


HANDLES: Mapping[str, Handle] = {
    "1": Handle(0.150, 0.040, 0.030),
    "2": Handle(0.110, 0.030, 0.020),
    "3": Handle(0.150, 0.036, 0.030),
    "4": Handle(0.140, 0.030, 0.030),
    "5": Handle(0.130, 0.014, 0.020),
    "full_size": Handle(0.130, 0.030, 0.030, friction=0.4, round=True),
}


def find(names: str | int | Sequence[str | int]) -> tuple[tuple[str, Handle], ...]:
    """Named handles of one name or a list.

    Raises:
        ConfigError: none, or an unknown one.
    """
    listed = [names] if isinstance(names, str | int) else list(names)
    if unknown := [name for name in listed if str(name) not in HANDLES]:
        raise ConfigError(f"door: unknown handle {', '.join(map(repr, unknown))}; known: {', '.join(HANDLES)}")
    if not listed:
        raise ConfigError(f"door: no handle given; known: {', '.join(HANDLES)}")
    return tuple((str(name), HANDLES[str(name)]) for name in listed)


def shape(handle: Handle) -> Callable[[mujoco.MjSpec], None]:
    """The edit that gives the door this handle, its visual twin included."""

    def edit(spec: mujoco.MjSpec) -> None:
        half = handle.length_m / 2
        for name in (f"{DOOR}_handle", f"{DOOR}_handle_visual"):
            geom = spec.geom(name)
            if geom is None:
                continue
            geom.pos = [half, -LEVER_DEPTH_M, 0.0]
            if handle.round:
                geom.type = mujoco.mjtGeom.mjGEOM_CYLINDER
                geom.size = [handle.thickness_m / 2, half, 0.0]
                geom.quat = [0.5**0.5, 0.0, 0.5**0.5, 0.0]
            else:
                geom.size = [half, handle.depth_m / 2, handle.thickness_m / 2]
            if handle.friction is not None:
                geom.friction = [handle.friction, 0.005, 1e-4]
                geom.priority = 1
        spec.site(f"{DOOR}_handle").pos = [handle.site_m, -LEVER_DEPTH_M, 0.0]

    return edit

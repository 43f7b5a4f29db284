"""The physics that our worlds share: their versions, and by what factors a world may differ from its own numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from p2l.errors import ConfigError
from p2l.sim.scene import Physics

# What has changed in the physics of our worlds; a row, a policy and a record belong to one version.
# 2: joint torques have robosuite's limits, and a box that is held still turns by 0.002 rad/s instead of 0.016.
# 3: a primitive starts where the hand is (`primitives.Primitive`); the physics are those of 2.
_LIMITED: Mapping[str, Any] = {"torque_limits": True, "impratio": 500.0}
VERSIONS: Mapping[int, Mapping[str, Any]] = {1: {}, 2: _LIMITED, 3: _LIMITED}
EVEN = (1.0,) * 6
PLAIN: Mapping[str, Any] = {
    "gain_scale": 1.0,
    "friction_scale": 1.0,
    "axis_scale": EVEN,
    "impratio": None,
    "air_density": 0.0,
    "joint_damping": None,
    "armature_scale": 1.0,
}
SCALE = (0.1, 10.0)  # what they may be: beyond, it is no longer the arm that holds, or the thing that is held
LIMITS: Mapping[str, tuple[float, float]] = {  # beyond these the simulation breaks down, or nothing moves any more
    "impratio": (1.0, 1e5),
    "air_density": (0.0, 100.0),
    "joint_damping": (0.0, 100.0),
}
VERSION = 3  # of a world that is not told another; chapter 4's door is of version 1, like its records


def physics_of(
    version: int,
    numbers: Mapping[str, float],
    *,
    gain_scale: float = 1.0,
    friction_scale: float = 1.0,
    axis_scale: Sequence[float] = EVEN,
    impratio: float | None = None,
    air_density: float = 0.0,
    joint_damping: float | None = None,
    armature_scale: float = 1.0,
) -> Physics:
    """The physics of a version of our worlds, with a world's own numbers.

    Args:
        version: of `VERSIONS`.
        numbers: of `Physics`.
        gain_scale: factor on the impedance's stiffnesses; dampings go with its root, so that it settles as before.
        friction_scale: factor on the sliding friction of every geom.
        axis_scale: factors on stiffness and damping, see `Physics`.
        impratio: see `Physics`; None is the version's.
        air_density: see `Physics`.
        joint_damping: see `Physics`; None is that of `numbers`.
        armature_scale: see `Physics`.

    Raises:
        ConfigError: there is no such version, a scale is far from 1, or a number is none that physics can have.
    """
    if version not in VERSIONS:
        raise ConfigError(f"unknown version {version} of the worlds; known: {', '.join(map(str, VERSIONS))}")
    scales = {"gain_scale": gain_scale, "friction_scale": friction_scale, "armature_scale": armature_scale}
    for name, scale in scales.items():
        if not SCALE[0] <= scale <= SCALE[1]:
            raise ConfigError(f"{name} must be a factor from {SCALE[0]:g} to {SCALE[1]:g}, got {scale}")
    if len(axis_scale) != 6 or not all(SCALE[0] <= scale <= SCALE[1] for scale in axis_scale):
        raise ConfigError(f"axis_scale must be six factors from {SCALE[0]:g} to {SCALE[1]:g}, got {list(axis_scale)}")
    given = {"impratio": impratio, "air_density": air_density, "joint_damping": joint_damping}
    for name, value in given.items():
        low, high = LIMITS[name]
        if value is not None and not low <= value <= high:
            raise ConfigError(f"{name} must lie between {low:g} and {high:g}, got {value}")
    physics = replace(Physics(**numbers), **VERSIONS[version])  # type: ignore[arg-type]
    stiffness = {name: gain_scale * getattr(physics, name) for name in ("stiffness_linear", "stiffness_angular")}
    damping = {name: gain_scale**0.5 * getattr(physics, name) for name in ("damping_linear", "damping_angular")}
    changed: dict[str, Any] = {
        "friction_scale": friction_scale,
        "axis_scale": tuple(axis_scale),
        "armature_scale": armature_scale,
    }
    changed |= stiffness | damping | {name: value for name, value in given.items() if value is not None}
    return replace(physics, **changed)


def varied(params: Mapping[str, Any]) -> dict[str, Any]:
    """A world's parameters without those of `physics_of` that change nothing.

    A row, a policy and a record belong to what is left: they were there before these parameters were.
    """
    left = dict(params)
    for name, plain in PLAIN.items():
        value = left.get(name)
        if (tuple(value) if isinstance(value, Sequence) else value) == plain:
            left.pop(name, None)
    return left

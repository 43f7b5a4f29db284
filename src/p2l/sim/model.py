"""From a scene to a model with Cartesian impedance control inside it.

The controller is part of the physics: a mocap body carries the target pose, and six actuators pull a site of the
robot (or of a held part) towards it. Each actuator acts along one axis of the target's frame with the force
`stiffness · (target − site) − damping · velocity`; the stiffness is the control input, so a policy's action is a
target pose and a stiffness (thesis, section 3.5, "Skill representation"), and every step runs in C.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco

from p2l.errors import ConfigError

TARGET_BODY = "impedance_target"
AXES = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True)
class Impedance:
    """A spring-damper between a site and a mocap target.

    Attributes:
        site: name of the site that follows the target.
        damping_linear: N·s/m along each axis, independent of the stiffness.
        damping_angular: N·m·s/rad about each axis.
        axis_scale: [6] factors on these along and about each axis.
    """

    site: str
    damping_linear: float
    damping_angular: float
    axis_scale: tuple[float, ...] = (1.0,) * 6


def add_impedance(spec: mujoco.MjSpec, impedance: Impedance) -> None:
    """Add the mocap target and the six actuators `impedance_{x,y,z,rx,ry,rz}` to a scene.

    Their controls are stiffnesses: N/m for the first three, N·m/rad for the last three.

    Raises:
        ConfigError: the scene has no such site, or a damping is negative.
    """
    if spec.site(impedance.site) is None:
        names = ", ".join(site.name for site in spec.sites) or "none"
        raise ConfigError(f"impedance: the scene has no site '{impedance.site}'; its sites: {names}")
    if min(impedance.damping_linear, impedance.damping_angular) < 0.0:
        raise ConfigError(f"impedance: damping must be at least 0, got {impedance}")
    target = spec.worldbody.add_body(name=TARGET_BODY, mocap=True)
    target.add_site(name=TARGET_BODY)
    for axis, label in enumerate(AXES):
        damping = impedance.axis_scale[axis] * (impedance.damping_linear if axis < 3 else impedance.damping_angular)
        actuator = spec.add_actuator(
            name=f"impedance_{label}",
            trntype=mujoco.mjtTrn.mjTRN_SITE,
            target=impedance.site,
            refsite=TARGET_BODY,
            gear=[float(axis == other) for other in range(6)],
        )
        # Force = control · (0 − 1·length) − damping · velocity: an affine gain makes the control a stiffness.
        actuator.gaintype = mujoco.mjtGain.mjGAIN_AFFINE
        actuator.gainprm = [0.0, -1.0] + [0.0] * 8
        actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        actuator.biasprm = [0.0, 0.0, -damping] + [0.0] * 7

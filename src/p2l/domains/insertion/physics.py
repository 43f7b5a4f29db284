"""Insertion under uncertainty in abstract simulation (thesis, section 3.5.1), and the peg board of table 3.1.

A compliant hold moves a part; the arm is dropped, the contacts with board and walls are MuJoCo's. Each scene is
written in the frame of its slot: origin at the centre of the slot's mouth, z up. A task is a slot and the walls
around it.

Deviations from the thesis, each where it is silent:
1. The compliant hold adds inertia (`hold_mass_kg`): it stands for the gripper that the abstraction drops.
2. `tip="peg"` gives the part a round tip, as the pegs of a Chinese-checkers board have; the block has a flat one.
3. Only walls within reach of the part (6 cm) are put in a scene; the others cannot be touched.

Axis letters: N rows, A walls of a scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from p2l.domains.insertion.features import PART_HALF_WIDTH, WALLS_PER_SCENE
from p2l.errors import ConfigError
from p2l.records import Array
from p2l.sim.batch import Engine
from p2l.sim.model import Impedance, add_impedance

PART_HALF_LENGTH = 0.03
WALL_HEIGHT = 0.025
BOARD_HALF = 0.1
POSITION_SENSOR = "grip_pos"


@dataclass(frozen=True)
class InsertionPhysics:
    """Settings of the abstract simulation (SI units).

    Attributes:
        tip: a flat block or a peg with a round tip.
        slot_half_width: half the side of the square slot, m.
        slot_depth: m.
        friction: sliding friction of all contacts.
        hold_mass_kg: mass of the part and its compliant hold.
        damping_linear: N·s/m.
        damping_angular: N·m·s/rad.
        timestep_s: physics time step.
        control_period_s: duration of a control step.
        hover: height of the tip above the board when a skill starts, m.
        inserted_share: share of the depth below which the tip counts as inserted.
    """

    tip: Literal["block", "peg"] = "block"
    slot_half_width: float = 0.006
    slot_depth: float = 0.02
    friction: float = 0.3
    hold_mass_kg: float = 0.2
    damping_linear: float = 8.0
    damping_angular: float = 0.04
    timestep_s: float = 0.004
    control_period_s: float = 0.048
    hover: float = 0.003
    inserted_share: float = 0.75


def build_model(walls: Array, physics: InsertionPhysics) -> mujoco.MjModel:
    """Compile one scene.

    Args:
        walls: [A, 4] centre x, y and half sizes x, y of each wall in the slot's frame, m; at most 8.
        physics: settings.

    Raises:
        ConfigError: too many walls, or an unknown tip.
    """
    if len(walls) > WALLS_PER_SCENE:
        raise ConfigError(
            f"insertion: {len(walls)} walls within reach of a slot; at most {WALLS_PER_SCENE} are allowed"
        )
    spec = mujoco.MjSpec()
    spec.option.timestep = physics.timestep_s
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.iterations = 20
    _add_board(spec, physics)
    for index in range(WALLS_PER_SCENE):
        if index < len(walls):
            x, y, half_x, half_y = walls[index]
            _add_box(spec, [x, y, WALL_HEIGHT / 2], [half_x, half_y, WALL_HEIGHT / 2], physics)
        else:  # models of one batch need the same number of shapes; these lie far below and touch nothing
            _add_box(spec, [0.0, 0.0, -1.0 - index], [0.01, 0.01, 0.01], physics)
    _add_part(spec, physics)
    add_impedance(spec, Impedance("grip", physics.damping_linear, physics.damping_angular))
    return spec.compile()


def _add_box(spec: mujoco.MjSpec, pos: list[float], size: list[float], physics: InsertionPhysics) -> None:
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=pos,
        size=size,
        friction=[physics.friction, 0.005, 1e-4],
        solref=[0.01, 1.0],
        condim=3,
        contype=1,
        conaffinity=2,
    )


def _add_board(spec: mujoco.MjSpec, physics: InsertionPhysics) -> None:
    slot, depth = physics.slot_half_width, physics.slot_depth
    side = (BOARD_HALF - slot) / 2
    for sign in (-1.0, 1.0):
        _add_box(spec, [sign * (slot + side), 0.0, -depth / 2], [side, BOARD_HALF, depth / 2], physics)
        _add_box(spec, [0.0, sign * (slot + side), -depth / 2], [slot, side, depth / 2], physics)
    _add_box(spec, [0.0, 0.0, -depth - 0.01], [2 * slot, 2 * slot, 0.01], physics)


def _add_part(spec: mujoco.MjSpec, physics: InsertionPhysics) -> None:
    body = spec.worldbody.add_body(name="part", pos=[0.0, 0.0, PART_HALF_LENGTH + physics.hover], gravcomp=1.0)
    body.add_freejoint()
    shape = {
        "block": (mujoco.mjtGeom.mjGEOM_BOX, [PART_HALF_WIDTH, PART_HALF_WIDTH, PART_HALF_LENGTH]),
        "peg": (mujoco.mjtGeom.mjGEOM_CAPSULE, [PART_HALF_WIDTH, PART_HALF_LENGTH - PART_HALF_WIDTH, 0.0]),
    }
    if physics.tip not in shape:
        raise ConfigError(f"insertion: unknown tip '{physics.tip}'; known tips: {', '.join(shape)}")
    kind, size = shape[physics.tip]
    body.add_geom(
        type=kind,
        size=size,
        mass=0.0,
        friction=[physics.friction, 0.005, 1e-4],
        solref=[0.01, 1.0],
        condim=3,
        contype=2,
        conaffinity=1,
    )
    body.mass, body.explicitinertial = physics.hold_mass_kg, True
    body.ipos, body.inertia = [0.0, 0.0, 0.0], [1e-3 * physics.hold_mass_kg] * 2 + [5e-4 * physics.hold_mass_kg]
    body.add_site(name="grip", pos=[0.0, 0.0, PART_HALF_LENGTH])
    body.add_site(name="tip", pos=[0.0, 0.0, -PART_HALF_LENGTH])
    for site in ("grip", "tip"):
        spec.add_sensor(
            name=f"{site}_pos",
            type=mujoco.mjtSensor.mjSENS_FRAMEPOS,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            objname=site,
        )


def start_states(engine: Engine, estimate_error: Array, physics: InsertionPhysics) -> Array:
    """[N, S] rows in which the part hovers upright above the estimated slot; `estimate_error` is [N, 2] m."""
    rows = len(estimate_error)
    qpos = np.zeros((rows, 7))
    qpos[:, :2] = estimate_error
    qpos[:, 2] = PART_HALF_LENGTH + physics.hover
    qpos[:, 3] = 1.0
    grip = qpos[:, :3] + [0.0, 0.0, PART_HALF_LENGTH]
    return engine.states_from(qpos, grip, np.array([1.0, 0.0, 0.0, 0.0]))


def is_inserted(tip_pos: Array, physics: InsertionPhysics) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """[N] whether the tip [N, 3] is deep enough in the slot."""
    return np.asarray(tip_pos[:, 2] < -physics.inserted_share * physics.slot_depth)

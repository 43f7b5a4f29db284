"""The table, the shelf and what goes onto it, out of robosuite's own classes (thesis, section 5.4.2).

The shelf is two pieces of furniture: a floor with walls, and a roof from which further walls hang down past them. Both
poses belong to a row's state, so position and inner height differ from row to row in one compiled model. Masses and the
clutter's sizes differ through a bank of variants of that model.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from robosuite.models.arenas import TableArena
from robosuite.models.objects import BottleObject, BoxObject, CanObject, CompositeObject, MujocoObject
from scipy.stats import qmc

from p2l.errors import ConfigError
from p2l.records import Array
from p2l.sim.scene import Parts, Physics, Scene, build, model_variant

Edit = Callable[[mujoco.MjModel], None]
Triple = tuple[float, float, float]
Slab = tuple[Triple, Triple]

BASE_POS_WORLD = (-0.56, 0.0, 0.0)  # robosuite's place of the robot at this table
TABLE_M = 0.8  # height of the table's top
TABLE_FULL_M = (0.8, 0.8, 0.05)
INNER_WIDTH_M = 0.3
DEPTH_M = 0.2
WALL_M = 0.01
LOWER_WALL_M = 0.2  # how far the walls of the lower part reach above the floor
UPPER_WALL_M = 0.12  # how far those of the upper part hang below the roof
FOOT_M = 0.1  # how far the lower walls reach below the floor
MAX_HEIGHT_M = LOWER_WALL_M + UPPER_WALL_M  # inner height up to which the walls have no gap
CLUTTER = ("clutter_left", "clutter_right")
CLUTTER_HALF_X_M = 0.02
WOOD = (0.62, 0.47, 0.32, 1.0)


@dataclass(frozen=True)
class Thing:
    """Something to be put onto the shelf.

    Attributes:
        make: the robosuite object.
        density: kg/m³ that `make` gives it.
        bottom_m: from its origin down to what it stands on.
        top_m: from its origin up to its highest point.
        half_width_m: half of what the fingers close on.
        half_depth_m: from its origin to the side that faces the hand.
        grip_before_m: how far before its origin, on the hand's side, the fingers hold it.
        grip_above_m: how far above its origin they do; low things are held high, where the hand clears the table.
        place_before_m: how far before the middle of the shelf it belongs; low things stay where the hand finds room.
    """

    make: Callable[[], MujocoObject]
    density: float
    bottom_m: float
    top_m: float
    half_width_m: float
    half_depth_m: float
    grip_before_m: float
    grip_above_m: float
    place_before_m: float


@dataclass(frozen=True)
class Clutter:
    """Two boxes that stand on the shelf.

    Attributes:
        half_y_m, half_z_m: ranges of their half sizes.
        density: kg/m³.
    """

    half_y_m: tuple[float, float]
    half_z_m: tuple[float, float]
    density: float


@dataclass(frozen=True)
class Bank:
    """Interchangeable scenes, and names and sizes in them.

    Attributes:
        scenes: K scenes; the visual model, which is large, is the same in all.
        edits: K edits that give a copy of the visual model a scene's own sizes.
        lower, upper: bodies of the shelf's two parts.
        object_joint: free joint of what is placed.
        clutter_joints: free joints of the clutter; none without clutter.
        clutter_half_m: [K, 2, 2] half depth and half height of each clutter box.
    """

    scenes: tuple[Scene, ...]
    edits: tuple[Edit, ...]
    lower: str
    upper: str
    object_joint: str
    clutter_joints: tuple[str, ...]
    clutter_half_m: Array


def _box(half_m: Triple, grip_before_m: float) -> Thing:
    def make() -> MujocoObject:
        return BoxObject("object", size=list(half_m), density=1000.0, rgba=[0.8, 0.25, 0.2, 1.0])

    half_width_m, half_depth_m, half_height_m = half_m
    return Thing(make, 1000.0, half_height_m, half_height_m, half_width_m, half_depth_m, grip_before_m, 0.0, 0.0)


THINGS: Mapping[str, Thing] = {
    "box": _box((0.02, 0.06, 0.08), 0.04),
    "box_small": _box((0.018, 0.05, 0.07), 0.037),
    "box_large": _box((0.022, 0.065, 0.085), 0.048),
    "bottle": Thing(lambda: BottleObject("object"), 50.0, 0.0649, 0.0951, 0.0276, 0.0293, 0.005, 0.0, 0.045),
    "can": Thing(lambda: CanObject("object"), 100.0, 0.0403, 0.0398, 0.025, 0.025, 0.005, 0.02, 0.045),
}


# From version 2 of the worlds on: an arm with motors of limited torque, and a hold that holds, fail less with the box
# held as deep as in version 1. Still farther out, boxes are dropped more often, but no fewer runs succeed.
HELD_FARTHER_OUT: Mapping[str, float] = {"box": 0.045}


def find(name: str, version: int) -> Thing:
    """The thing of that name, as it is in a version of the worlds.

    Raises:
        ConfigError: unknown; the message lists the known ones.
    """
    if name not in THINGS:
        raise ConfigError(f"unknown object '{name}'; known objects: {', '.join(THINGS)}")
    thing = THINGS[name]
    if version == 1:
        return thing
    return dataclasses.replace(thing, grip_before_m=HELD_FARTHER_OUT.get(name, thing.grip_before_m))


def compose(
    arm: str, thing: Thing, physics: Physics, density: tuple[float, float], clutter: Clutter | None, models: int
) -> Bank:
    """Compose and compile once, then edit a copy for each of K = `models` densities and sizes of clutter.

    Args:
        arm: robosuite's name of the arm.
        thing: what is placed.
        physics: of the simulation and the impedance.
        density: range of the thing's density, kg/m³; the models divide it evenly.
        clutter: what stands on the shelf, or None.
        models: K.
    """
    arena = TableArena(table_full_size=TABLE_FULL_M, table_offset=(0.0, 0.0, TABLE_M))
    arena.set_origin([0, 0, 0])
    lower, upper, payload = _lower(), _upper(), thing.make()
    boxes = [] if clutter is None else [_clutter_box(name, clutter) for name in CLUTTER]
    pose_sensors = {"object": payload.root_body} | {
        name: box.root_body for name, box in zip(CLUTTER, boxes, strict=False)
    }
    furniture = (lower.root_body, upper.root_body)
    parts = Parts(arena, [payload, *boxes, lower, upper], BASE_POS_WORLD, furniture, pose_sensors)
    scene = build(arm, parts, physics)
    share = (np.arange(models) + 0.5) / models
    spread = np.zeros((models, 2, 2)) if clutter is None else _sizes(clutter, models)
    edits = tuple(
        _edit(payload.root_body, (low_high(density, share[k])) / thing.density, boxes, spread[k], clutter)
        for k in range(models)
    )
    scenes = tuple(dataclasses.replace(scene, model=model_variant(scene.model, edit)) for edit in edits)
    joints = tuple(box.joints[0] for box in boxes)
    return Bank(scenes, edits, lower.root_body, upper.root_body, payload.joints[0], joints, spread)


def low_high(ends: tuple[float, float], share: float) -> float:
    """The number at a share of the way from the low end to the high one."""
    return ends[0] + share * (ends[1] - ends[0])


def _sizes(clutter: Clutter, models: int) -> Array:
    spread = qmc.Halton(4, scramble=False).random(models + 1)[1:].reshape(models, 2, 2)
    low = np.array([clutter.half_y_m[0], clutter.half_z_m[0]])
    high = np.array([clutter.half_y_m[1], clutter.half_z_m[1]])
    return np.asarray(low + spread * (high - low))


def _edit(body: str, scale: float, boxes: Sequence[MujocoObject], halves: Array, clutter: Clutter | None) -> Edit:
    def edit(model: mujoco.MjModel) -> None:
        model.body(body).mass *= scale
        model.body(body).inertia *= scale
        for box, (half_y, half_z) in zip(boxes, halves, strict=False):
            half = np.array([CLUTTER_HALF_X_M, half_y, half_z])
            # Bounding volumes stay those of the largest box that was compiled: they may be too large, never too small.
            of_box = model.geom_bodyid == model.body(box.root_body).id
            model.geom_size[of_box] = half
            mass = 8.0 * half.prod() * (clutter.density if clutter else 0.0)
            model.body(box.root_body).mass = mass
            model.body(box.root_body).inertia = mass / 3.0 * (np.sum(half**2) - half**2)

    return edit


def _clutter_box(name: str, clutter: Clutter) -> MujocoObject:
    half = [CLUTTER_HALF_X_M, clutter.half_y_m[1], clutter.half_z_m[1]]
    return BoxObject(name, size=half, density=clutter.density, rgba=[0.25, 0.45, 0.7, 1.0])


def shelf_parts() -> tuple[MujocoObject, MujocoObject]:
    """The shelf's lower and upper part, two robosuite objects without joints, for whoever composes a scene himself."""
    return _lower(), _upper()


def _lower() -> MujocoObject:
    """Floor, side walls and back; the origin is the middle of the floor's top."""
    side = (INNER_WIDTH_M + WALL_M) / 2
    middle, half = (LOWER_WALL_M - FOOT_M) / 2, (LOWER_WALL_M + FOOT_M) / 2
    floor = ((0.0, 0.0, -WALL_M / 2), (INNER_WIDTH_M / 2, DEPTH_M / 2, WALL_M / 2))
    return _furniture("shelf", [floor, *_walls(side, middle, half)])


def _upper() -> MujocoObject:
    """Roof and the walls that hang from it; the origin is the middle of the roof's lower face."""
    side = (INNER_WIDTH_M + WALL_M) / 2
    roof = ((0.0, 0.0, WALL_M / 2), (INNER_WIDTH_M / 2 + WALL_M, DEPTH_M / 2, WALL_M / 2))
    return _furniture("roof", [roof, *_walls(side, -UPPER_WALL_M / 2, UPPER_WALL_M / 2)])


def _walls(side: float, middle_z: float, half_z: float) -> list[Slab]:
    back = DEPTH_M / 2 + WALL_M / 2
    return [
        ((-side, 0.0, middle_z), (WALL_M / 2, DEPTH_M / 2, half_z)),
        ((side, 0.0, middle_z), (WALL_M / 2, DEPTH_M / 2, half_z)),
        ((0.0, back, middle_z), (INNER_WIDTH_M / 2 + WALL_M, WALL_M / 2, half_z)),
    ]


def _furniture(name: str, slabs: Sequence[Slab]) -> MujocoObject:
    return CompositeObject(
        name,
        total_size=[INNER_WIDTH_M / 2 + WALL_M, DEPTH_M / 2 + WALL_M, LOWER_WALL_M],
        geom_types=["box"] * len(slabs),
        geom_sizes=[size for _, size in slabs],
        geom_locations=[place for place, _ in slabs],
        geom_rgbas=[WOOD] * len(slabs),
        locations_relative_to_center=True,
        joints=None,
    )

"""Where things may stand at the start of an execution at the shelf, and whether the arm reaches them.

Axis letters: N rows, K models.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import product
from typing import Any

import mujoco
import numpy as np

from p2l import poses
from p2l.errors import ConfigError
from p2l.records import Array
from p2l.sim.posture import reach
from p2l.sim.scene import Scene
from p2l.worlds.shelf.scene import (
    CLUTTER_HALF_X_M,
    DEPTH_M,
    FOOT_M,
    INNER_WIDTH_M,
    MAX_HEIGHT_M,
    TABLE_FULL_M,
    TABLE_M,
    WALL_M,
    Thing,
)

Range = tuple[float, float]
START_BEFORE_M = 0.07  # the hand starts so far before the side that faces it
APPROACH_M = 0.03  # the thing waits so far before the shelf's mouth until it is moved in
CARRY_M = 0.12  # how high it is lifted from the table
AWAY_M = 0.24  # how far the hand leaves it


@dataclass(frozen=True)
class Starts:
    """Uniform ranges [low, high] of what differs from execution to execution, m, world frame.

    Attributes:
        object_x_m, object_y_m: the thing's place on the table.
        shelf_x_m, shelf_y_m: the middle of the shelf's floor.
        shelf_lift_m: its height above the table.
        shelf_height_m: the shelf's inner height.
        clutter_x_m: distance of each clutter box from the middle of the shelf, one to each side.
        clutter_y_m: their depth; kept between the middle of the shelf and its back wall.
    """

    object_x_m: Range
    object_y_m: Range
    shelf_x_m: Range
    shelf_y_m: Range
    shelf_lift_m: Range
    shelf_height_m: Range
    clutter_x_m: Range
    clutter_y_m: Range

    def draw(self, rng: np.random.Generator, n: int) -> Layouts:
        """N independent draws."""
        value = {name: rng.uniform(ends[0], ends[1], (n, 2)) for name, ends in vars(self).items()}
        one = {name: pair[:, 0] for name, pair in value.items()}
        floor = np.stack([one["shelf_x_m"], one["shelf_y_m"], TABLE_M + one["shelf_lift_m"]], axis=1)
        place = np.stack([one["object_x_m"], one["object_y_m"]], axis=1)
        return Layouts(place, floor, one["shelf_height_m"], value["clutter_x_m"], value["clutter_y_m"])


@dataclass(frozen=True)
class Layouts:
    """N layouts of the scene.

    Attributes:
        object_m: [N, 2] place of the thing on the table.
        floor_m: [N, 3] middle of the shelf's floor.
        height_m: [N] inner height.
        clutter_x_m, clutter_y_m: [N, 2] of the left and the right clutter box, see `Starts`.
    """

    object_m: Array
    floor_m: Array
    height_m: Array
    clutter_x_m: Array
    clutter_y_m: Array

    @property
    def roof_m(self) -> Array:
        """[N, 3] middle of the roof's lower face."""
        return self.floor_m + self.height_m[:, None] * np.array([0.0, 0.0, 1.0])

    def clutter_pos_m(self, half_m: Array) -> Array:
        """[N, 2, 3] centres of the clutter boxes, given their half depths and half heights [N, 2, 2]."""
        side = np.array([-1.0, 1.0])
        deepest = self.floor_m[:, None, 1] + DEPTH_M / 2 - half_m[..., 0] - 0.002
        y = np.clip(self.clutter_y_m, self.floor_m[:, None, 1], deepest)
        return np.stack(
            [self.floor_m[:, None, 0] + side * self.clutter_x_m, y, self.floor_m[:, None, 2] + half_m[..., 1]], axis=2
        )


def starts_of(thing: Thing, params: Mapping[str, Sequence[float]]) -> Starts:
    """The ranges of `Starts` out of a world's parameters, refused where things would stand in one another.

    Raises:
        ConfigError: naming the range, its value and its bounds.
    """
    half_table = TABLE_FULL_M[0] / 2
    bounds: Mapping[str, Range] = {
        "object_x_m": (-half_table, half_table),
        "object_y_m": (-half_table, half_table),
        "shelf_lift_m": (WALL_M, FOOT_M),
        "shelf_height_m": (thing.bottom_m + thing.top_m + 0.01, MAX_HEIGHT_M),
        "clutter_x_m": (0.045, INNER_WIDTH_M / 2 - CLUTTER_HALF_X_M),
    }
    return Starts(**{f.name: interval(f.name, params[f.name], bounds.get(f.name, (-1.0, 1.0))) for f in fields(Starts)})


def interval(name: str, pair: Sequence[float], bounds: Range) -> Range:
    """`pair` as [low, high].

    Raises:
        ConfigError: reversed, not finite, or outside of `bounds`.
    """
    if len(pair) != 2 or not np.isfinite(pair).all() or pair[0] > pair[1]:
        raise ConfigError(f"shelf: {name} must be [low, high] with low ≤ high, got {list(pair)}")
    if pair[0] < bounds[0] or pair[1] > bounds[1]:
        raise ConfigError(f"shelf: {name} must lie within [{bounds[0]:g}, {bounds[1]:g}], got {list(pair)}")
    return float(pair[0]), float(pair[1])


def positive(params: Mapping[str, Any], *names: str) -> None:
    """Refuse parameters that are not above 0."""
    for name in names:
        if not params[name] > 0:
            raise ConfigError(f"shelf: {name} must be positive, got {params[name]}")


def vector(name: str, values: Sequence[float], size: int) -> tuple[float, ...]:
    """`values`, refused where there are not `size` of them."""
    if len(values) != size:
        raise ConfigError(f"shelf: {name} must hold {size} numbers, got {list(values)}")
    return tuple(values)


def facing_shelf(fingers: float) -> Array:
    """[4] orientation of a hand that points to the shelf and closes along x; `fingers` ±1 says which one is left."""
    return np.asarray(poses.frame(np.array([[fingers, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]]))[0])


def posture(scene: Scene, thing: Thing, starts: Starts) -> tuple[Array, Array]:
    """Start posture [J] of the arm, rad, and orientation [4] of the hand that reach everything the task asks for.

    Raises:
        ConfigError: naming the first place that has no posture which the start leads to.
    """
    problems = []
    for quat in (facing_shelf(1.0), facing_shelf(-1.0)):
        first, *others = _places(thing, starts)
        start = reach(scene, first, quat)
        if start is None:
            problems.append(first)
            continue
        if _touches(scene, start):
            continue
        far = [place for place in others if reach(scene, place, quat, starts=[start], restarts=0) is None]
        if not far:
            return start, quat
        problems.append(far[0])
    where = "; ".join(np.array2string(place, precision=3) for place in problems) or "the start, clear of the table"
    raise ConfigError(
        f"shelf: the arm has no posture with the hand facing the shelf at {where} (world, m); "
        "bring object_x_m, object_y_m, shelf_x_m, shelf_y_m or shelf_lift_m closer to it, or take another arm"
    )


def _places(thing: Thing, starts: Starts) -> list[Array]:
    """Where the grip site must get to: first the start, then the extremes of grasp, lift, both sides of the mouth."""
    grip, height = thing.grip_before_m, TABLE_M + thing.bottom_m + thing.grip_above_m
    goal_depth = grip + thing.place_before_m
    side = thing.half_depth_m + START_BEFORE_M
    middle = np.array([np.mean(starts.object_x_m), np.mean(starts.object_y_m) - side, height])
    places = [middle]
    for x, y in product(starts.object_x_m, starts.object_y_m):
        places += [np.array([x, y - grip, height + up]) for up in (0.0, CARRY_M)]
    out = DEPTH_M / 2 + thing.half_depth_m + APPROACH_M
    for x, y, lift in product(starts.shelf_x_m, starts.shelf_y_m, starts.shelf_lift_m):
        places += [np.array([x, y - before - goal_depth, height + lift]) for before in (0.0, out, AWAY_M)]
    return places


def _touches(scene: Scene, arm: Array) -> bool:
    """Whether the arm is in contact with anything when everything else is where the model has it."""
    model, data = scene.model, mujoco.MjData(scene.model)
    for joint, angle in zip(scene.arm_joints, arm, strict=True):
        data.qpos[int(model.joint(joint).qposadr[0])] = angle
    mujoco.mj_forward(model, data)
    robot = np.array([model.body(i).name.startswith(("robot0_", "gripper0_")) for i in range(model.nbody)])
    pairs = [robot[model.geom_bodyid[contact.geom]] for contact in data.contact if contact.dist < 0.0]
    return any(one != other for one, other in pairs)

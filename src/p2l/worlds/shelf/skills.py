"""Pick, Move and Place for a thing that stands on a table and belongs onto a shelf (thesis, section 5.4.2).

Open loop, and right if the thing is where it is observed. Move knows the place of the shelf. Place is meant for the
pose in which Move ends and goes by it: straight in from wherever the hand is, down by the clearance, release, back.
Started from deeper inside, it goes on until the thing is pressed against the back of the shelf (thesis, figure 5.9).

Axis letters: N rows, W waypoints.
"""

from __future__ import annotations

import numpy as np

from p2l.contracts.observation import Observation, Privileged
from p2l.records import Array, BoolArray
from p2l.skills.follow import Follow, Waypoints
from p2l.worlds.shelf.hold import UPRIGHT, upright_distance
from p2l.worlds.shelf.scene import DEPTH_M, TABLE_M, Thing
from p2l.worlds.shelf.starts import APPROACH_M, AWAY_M, CARRY_M

CLEARANCE_M = {1: 0.003, 2: 0.002, 3: 0.002}  # between what is carried and the shelf's floor, by version of the worlds
BEFORE_M = 0.06  # from the thing's near side back to the pose before the grasp
NEAR_M = 0.01  # a thing that is no farther above the table stands on it
ASIDE_M = 0.05  # Place brings it to the middle of the shelf from that far
SAG_M = 0.002  # what is carried sinks by so much on its way to the shelf, and again on its way in
BEYOND_M = 0.05  # how far Place goes past the middle of the shelf, if it starts too deep inside
STEPS = {"pick": (8, 10, 8, 10), "move": (18,), "place": (14, 5, 6, 14)}  # control steps of each leg
SETTLE = {"pick": (0, 2, 8, 2), "move": (6,), "place": (2, 1, 6, 2)}  # of these, standing still at the end


def options(thing: Thing, hand_quat: Array, version: int) -> tuple[Follow, ...]:
    """The nominal chain for a thing, with the hand turned as `hand_quat` [4]."""
    mouth, clearance_m = DEPTH_M / 2 + thing.half_depth_m + APPROACH_M, CLEARANCE_M[version]

    def way(points: list[Array], grip: list[float]) -> Waypoints:
        rows, count = len(points[0]), len(points)
        quat = np.tile(hand_quat, (rows, count, 1))
        return Waypoints(np.stack(points, axis=1), quat, np.tile(grip, (rows, 1)))

    def pick(observation: Observation) -> Waypoints:
        grasp = observation["object_pos_m"] + [0.0, -thing.grip_before_m, thing.grip_above_m]
        before = observation["object_pos_m"] + [0.0, -thing.half_depth_m - BEFORE_M, thing.grip_above_m]
        return way([before, grasp, grasp, grasp + [0.0, 0.0, CARRY_M]], [0.0, 0.0, 1.0, 1.0])

    def move(observation: Observation) -> Waypoints:
        goal = grip_goal(observation)
        return way([goal + [0.0, -mouth, clearance_m]], [1.0])

    def place(observation: Observation) -> Waypoints:
        target, goal = observation["target_pos_m"], grip_goal(observation)
        deep = np.clip(target[:, 1] + mouth, goal[:, 1], goal[:, 1] + BEYOND_M)
        inside = np.stack([goal[:, 0], deep, target[:, 2]], axis=1)
        down = inside - [0.0, 0.0, clearance_m]
        return way([inside, down, down, down - [0.0, AWAY_M, 0.0]], [1.0, 1.0, 0.0, 0.0])

    def grip_goal(observation: Observation) -> Array:
        deep, up = -thing.place_before_m - thing.grip_before_m, thing.bottom_m + thing.grip_above_m
        return observation["shelf_pos_m"] + [0.0, deep, up]

    def can_pick(truth: Privileged) -> BoolArray:
        """It stands on the table, the hand is empty and on this side of it."""
        height = truth["object_pos_m"][:, 2] - TABLE_M - thing.bottom_m
        ahead = truth["object_pos_m"][:, 1] - truth["grip_pos_m"][:, 1]
        stands = (np.abs(height) < NEAR_M) & (upright_distance(truth["object_quat"]) < UPRIGHT)
        return np.asarray(stands & (truth["held"][:, 0] == 0) & (ahead > thing.half_depth_m))

    def can_move(truth: Privileged) -> BoolArray:
        """It is held upright, and hangs so that it fits between floor and roof where Move goes."""
        hangs = truth["grip_pos_m"][:, 2] - truth["object_pos_m"][:, 2] - thing.grip_above_m
        return upright_in_hand(truth) & fits(truth, clearance_m - hangs - SAG_M)

    def can_place(truth: Privileged) -> BoolArray:
        """It is held upright in front of the shelf or inside, and fits between floor and roof as it is."""
        aside = np.abs(truth["object_pos_m"] - truth["shelf_pos_m"])[:, 0]
        return upright_in_hand(truth) & fits(truth, truth["object_above_floor_m"][:, 0]) & (aside < ASIDE_M)

    def fits(truth: Privileged, above: Array) -> BoolArray:
        roof = truth["shelf_height_m"][:, 0] - thing.bottom_m - thing.top_m
        return np.asarray((above > SAG_M) & (above < roof))

    return (
        Follow("pick", pick, STEPS["pick"], SETTLE["pick"], can_pick),
        Follow("move", move, STEPS["move"], SETTLE["move"], can_move),
        Follow("place", place, STEPS["place"], SETTLE["place"], can_place),
    )


def upright_in_hand(truth: Privileged) -> BoolArray:
    """[N] whether the thing is in the hand, and stands straight there."""
    return np.asarray((truth["held"][:, 0] > 0) & (upright_distance(truth["object_quat"]) < UPRIGHT))

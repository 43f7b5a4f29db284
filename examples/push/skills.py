"""The nominal chain of the push world: come alongside, then push."""

from __future__ import annotations

import numpy as np

from examples.push.scene import HALF_BLOCK_M
from p2l.contracts.observation import Observation, Privileged
from p2l.contracts.option import Option
from p2l.records import Array, BoolArray
from p2l.skills.follow import Follow, Waypoints

GOAL_X_M = 0.12
DOWN = np.array([1.0, 0.0, 0.0, 0.0])


def options() -> tuple[Option, ...]:
    """Both are open loop, and miss the block where the estimate of its place is off."""
    return Follow("align", _align, (10,), (3,), behind), Follow("push", _push, (30,), (5,), aligned)


def _align(observation: Observation) -> Waypoints:
    pos = np.stack(
        [np.full(len(observation), -0.08), observation["block_y_m"][:, 0], np.full(len(observation), HALF_BLOCK_M)],
        axis=1,
    )
    return _one_leg(pos)


def _push(observation: Observation) -> Waypoints:
    return _one_leg(observation["target_pos_m"] * [0.0, 1.0, 1.0] + [GOAL_X_M, 0.0, 0.0])


def _one_leg(pos: Array) -> Waypoints:
    return Waypoints(pos[:, None], np.tile(DOWN, (len(pos), 1, 1)), np.zeros((len(pos), 1)))


def behind(truth: Privileged) -> BoolArray:
    """[N] the hand is on the near side of the block."""
    return truth["grip_pos_m"][:, 0] < truth["block_pos_m"][:, 0] - HALF_BLOCK_M


def aligned(truth: Privileged) -> BoolArray:
    """[N] and about on its middle line."""
    beside = np.abs(truth["grip_pos_m"][:, 1] - truth["block_pos_m"][:, 1])
    return behind(truth) & (beside < 0.5 * HALF_BLOCK_M)

"""GoToGrasp, Pick, GoToGoal and Place: closed-loop state machines that know nothing of walls (thesis, section 5.4.1).

The hand always faces down. It keeps the quarter turn about the vertical that its target is closest to when an option
starts, so an option that is used after a turn of the hand (or of its target) does not turn it back.

Axis letters: N rows.
"""

from __future__ import annotations

import numpy as np

from p2l import poses
from p2l.contracts.observation import Observation, Privileged
from p2l.records import Array, BoolArray, IntArray
from p2l.skills.machine import Machine, Phase, link
from p2l.worlds.pick_place.bins import (
    BIN1_POS_M,
    BIN_INNER_HALF_M,
    DOWN,
    FLOOR_M,
    HAND_HALF_M,
    LIFT_M,
    QUARTER_M,
)

TOP_M = 0.03  # robosuite's height of the bread's top above its centre
HOVER_M = 0.05
OVER_GOAL_M = QUARTER_M + np.array([0.0, 0.0, 0.2])
AT_GOAL_M = QUARTER_M + np.array([0.0, 0.0, 0.1])
ALIGNED_M, ALIGNED_RAD = 0.01, 0.15  # the hand goes down only where it is this close to straight above the bread
RELEASE_GAP_M = 0.07
GRASP_GAP_M = (0.02, 0.065)  # opening of fingers that are closed on the bread, along whichever side


def options() -> tuple[Machine, ...]:
    """The nominal chain."""
    chain = (
        Machine("go_to_grasp", (Phase(_hover, grip=0.0),), quarter_turn, can_go_to_grasp),
        Machine(
            "pick",
            (
                Phase(_down, grip=0.0, pace_m=0.025),
                Phase(_stay, grip=1.0, still_m=5e-4, reached_m=np.inf, reached_rad=np.inf, at_least=4),
                Phase(_lift, grip=1.0, pace_m=0.025),
            ),
            quarter_turn,
            can_pick,
            enter=_pick_phase,
        ),
        Machine("go_to_goal", (Phase(_over_goal, grip=1.0),), quarter_turn, can_go_to_goal),
        Machine(
            "place",
            (
                Phase(_at_goal, grip=1.0, pace_m=0.025),
                Phase(_stay, grip=0.0, open_m=RELEASE_GAP_M, reached_m=np.inf, reached_rad=np.inf, at_least=6),
            ),
            quarter_turn,
            can_place,
        ),
    )
    return link(chain)


def quarter_turn(observation: Observation) -> Array:
    """[N, 4] the orientation facing down with the quarter turn that the hand's target is closest to."""
    hand = poses.unit(observation["target_quat"])
    x_axis = poses.image(hand, [1.0, 0.0, 0.0])
    steep = np.linalg.norm(x_axis[:, :2], axis=1) < 0.5  # the hand lies on its side: the other axis tells the turn
    if steep.any():
        x_axis[steep] = np.cross(poses.image(hand[steep], [0.0, 1.0, 0.0]), DOWN)
    quarters = np.round(np.arctan2(x_axis[:, 1], x_axis[:, 0]) / (np.pi / 2)).astype(np.int64)
    return _QUARTER_TURNS[quarters + 2]


def _quarter_turns() -> Array:
    """[5, 4] orientations facing down by −2 … 2 quarters about the vertical."""
    turns = np.arange(-2, 3) * np.pi / 2
    return poses.frame(np.stack([np.cos(turns), np.sin(turns), np.zeros(5)], axis=1), np.tile(DOWN, (5, 1)))


_QUARTER_TURNS = _quarter_turns()


def _hover(observation: Observation) -> Array:
    return np.asarray(observation["object_pos_m"] + [0.0, 0.0, TOP_M + HOVER_M])


def _down(observation: Observation) -> Array:
    bread = observation["object_pos_m"]
    turn = poses.angle(observation["grip_quat"], observation["target_quat"])
    aside = np.linalg.norm(observation["grip_pos_m"][:, :2] - bread[:, :2], axis=1)
    astray = np.maximum(aside - ALIGNED_M, 0.0) + HAND_HALF_M * np.maximum(turn - ALIGNED_RAD, 0.0)
    height = np.maximum(bread[:, 2], FLOOR_M + 0.02) + np.minimum(2.0 * astray, TOP_M + HOVER_M)
    return np.column_stack([bread[:, :2], height])


def _stay(observation: Observation) -> Array:
    return observation["target_pos_m"]


def _lift(observation: Observation) -> Array:
    return np.column_stack([observation["target_pos_m"][:, :2], np.full(len(observation), LIFT_M)])


def _over_goal(observation: Observation) -> Array:
    return np.tile(OVER_GOAL_M, (len(observation), 1))


def _at_goal(observation: Observation) -> Array:
    return np.tile(AT_GOAL_M, (len(observation), 1))


def _pick_phase(observation: Observation) -> IntArray:
    """Lift at once where the bread is already in the closed hand."""
    in_fingers = _bread_in_fingers(observation["object_in_grip_m"], observation["gap_m"])
    return np.where(in_fingers & (observation["grip_command"][:, 0] > 0.5), 2, 0)


def _bread_in_fingers(object_in_grip: Array, gap: Array) -> BoolArray:
    near = np.linalg.norm(object_in_grip, axis=1) < 0.03
    return np.asarray(near & (gap[:, 0] > GRASP_GAP_M[0]) & (gap[:, 0] < GRASP_GAP_M[1]))


def can_go_to_grasp(truth: Privileged) -> BoolArray:
    """The bread lies in its bin; how close to a wall does not count, as the skills know nothing of walls."""
    aside = np.abs(truth["object_pos_m"][:, :2] - BIN1_POS_M[:2])
    low = truth["object_pos_m"][:, 2] < FLOOR_M + 0.05
    return np.asarray((aside < BIN_INNER_HALF_M).all(axis=1) & low & ~_in_hand(truth))


def can_pick(truth: Privileged) -> BoolArray:
    """The same, and the hand hovers over the bread, facing down, with open fingers."""
    away = truth["grip_pos_m"] - truth["object_pos_m"]
    over = (np.linalg.norm(away[:, :2], axis=1) < 0.04) & (away[:, 2] > 0.04) & (away[:, 2] < 0.15)
    return np.asarray(can_go_to_grasp(truth) & over & _faces_down(truth) & (truth["gap_m"][:, 0] > GRASP_GAP_M[1]))


def can_go_to_goal(truth: Privileged) -> BoolArray:
    """The bread is in the hand, above every wall."""
    return np.asarray(_in_hand(truth) & (truth["object_pos_m"][:, 2] > BIN1_POS_M[2] + 0.14) & _faces_down(truth))


def can_place(truth: Privileged) -> BoolArray:
    """The bread is in the hand, above its quarter of the other bin."""
    aside = np.abs(truth["object_pos_m"][:, :2] - OVER_GOAL_M[:2])
    return np.asarray(can_go_to_goal(truth) & (aside < 0.06).all(axis=1))


def _in_hand(truth: Privileged) -> BoolArray:
    return _bread_in_fingers(truth["object_in_grip_m"], truth["gap_m"])


def _faces_down(truth: Privileged) -> BoolArray:
    return np.asarray(poses.rotate(poses.rotation(truth["grip_quat"]), [0.0, 0.0, 1.0])[:, 2] < -0.9)

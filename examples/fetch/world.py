"""Gymnasium-Robotics' FetchPickAndPlace-v4 with three scripted controllers: reach, grasp, move.

The robot's estimate of the object errs by a few centimetres and gets better with every action; a grasp beside the
object is felt by the fingers, which close on nothing.

    python -m stages.discover world=fetch --config-dir examples/conf   # failures; then cluster, chain_recoveries, watch
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from p2l.contracts.estimator import Mode
from p2l.worlds.gymnasium import Controller, GymnasiumWorld, Noise, box_primitives

ABOVE_M = 0.08
OPEN, CLOSED = 1.0, -1.0
GAIN = 10.0  # of a position error in m; the environment's actions are at most 1, 5 cm
EMPTY_M = 0.015  # each finger's opening below which there is nothing between them (the object's half is 25 mm)


def make_env() -> gymnasium.Env[Any, Any]:
    """One environment; its time limit is out of the way, since options and recoveries have bounds of their own."""
    import gymnasium_robotics

    gymnasium.register_envs(gymnasium_robotics)
    return gymnasium.make("FetchPickAndPlace-v4", max_episode_steps=2000, render_mode="rgb_array")


def towards(obs: dict[str, Any], goal: Any, grip: float) -> tuple[Any, float]:
    """The action that moves the gripper to a position, world frame, m; and how far away it is, m."""
    away = goal - obs["observation"][0:3]
    return np.append(np.clip(GAIN * away, -1.0, 1.0), grip), float(np.linalg.norm(away))


def reach(obs: dict[str, Any], memory: Any) -> tuple[Any, Any, bool]:
    """Above the object, with open fingers."""
    action, away = towards(obs, obs["observation"][3:6] + [0.0, 0.0, ABOVE_M], OPEN)
    return action, memory, away < 0.015


def grasp(obs: dict[str, Any], memory: Any) -> tuple[Any, Any, bool]:
    """Down, close, and up again; remembers how long the fingers have been closing."""
    closing = memory[0]
    action, away = towards(obs, obs["observation"][3:6], OPEN)
    if closing or away < 0.01:
        closing += 1
        action = np.array([0.0, 0.0, 0.0 if closing < 8 else 0.5, CLOSED])
    return action, np.array([closing]), closing > 12


def move(obs: dict[str, Any], memory: Any) -> tuple[Any, Any, bool]:
    """The object to its goal, then hold it there."""
    hold = memory[0]
    action, away = towards(obs, obs["desired_goal"], CLOSED)
    hold += away < 0.02
    return action, np.array([hold]), hold > 5


def success(info: dict[str, Any], obs: dict[str, Any]) -> bool:
    """The object is at its goal, in the hand: one that was never lifted may lie there by chance."""
    in_hand = np.linalg.norm(obs["observation"][6:9]) < 0.03 and obs["observation"][9:11].max() > EMPTY_M
    return bool(info["is_success"] and in_hand)


def failed(info: dict[str, Any], obs: dict[str, Any]) -> str | None:
    """What the fingers feel: nothing between them where there should be something."""
    closed = obs["observation"][9:11].max() < EMPTY_M
    if info["controller"] == "grasp" and info["controller_step"] > 10 and closed:
        return "missed"
    return "dropped" if info["controller"] == "move" and closed else None


def world(sigma_m: float = 0.04, estimator: Mode = "halving", processes: int = 2) -> GymnasiumWorld:
    """The environment as a world.

    Args:
        sigma_m: of the estimated horizontal position of the object at the start, m.
        estimator: how the error develops.
        processes: environments that work at the same time.
    """
    return GymnasiumWorld(
        "fetch",
        make_env,
        [Controller("reach", reach, 40), Controller("grasp", grasp, 40, 1), Controller("move", move, 50, 1)],
        success=success,
        primitives=box_primitives(0.5, 4, ["x", "y", "z", "grip"], keep=["grip"]),
        failed=failed,
        failures=["missed", "dropped"],
        noise=[Noise(sigma_m, ["observation[3:5]", "observation[6:8]", "achieved_goal[0:2]"])],
        estimator=estimator,
        fields={"grip_pos_m": "observation[0:3]", "object_pos_m": "observation[3:6]", "fingers_m": "observation[9:11]"},
        position="observation[0:3]",
        mode_fields=["grip_pos_m - object_pos_m", "fingers_m"],
        processes=processes,
    )

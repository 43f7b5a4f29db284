"""Scripted controllers for Gymnasium-Robotics' FetchPickAndPlace-v4: reach, grasp, move; nothing of p2l is in here.

A controller is a function from an observation and its memory to an action, the new memory and whether it has ended.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

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

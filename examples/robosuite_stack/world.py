"""robosuite's Stack, unmodified, with its own controller (OSC_POSE) and hand-written skills: reach, grasp, place.

The robot's estimates of both cubes err by some centimetres and get better with every action.

    python -m stages.discover world=stack --config-dir examples/conf
"""

from __future__ import annotations

from typing import Any

import numpy as np

from p2l.contracts.estimator import Mode
from p2l.worlds.gymnasium import Controller, GymnasiumWorld, Noise, RobosuiteEnv, box_primitives

ABOVE_M, ON_TOP_M = 0.10, 0.048  # over a cube; between the centres of two stacked ones, a little in the air
OPEN, CLOSED = -1.0, 1.0
GAIN = 12.0  # of a position error in m; an action of 1 is 5 cm
KEYS = [
    "robot0_eef_pos",
    "robot0_eef_quat",
    "robot0_gripper_qpos",
    "cubeA_pos",
    "cubeA_quat",
    "cubeB_pos",
    "cubeB_quat",
]
EMPTY_M = 0.012  # opening of a finger below which there is nothing between them (half of the cube is 20 mm)


def make_env() -> RobosuiteEnv:
    """One environment with gymnasium's interface."""
    import robosuite

    settings = {"has_renderer": False, "has_offscreen_renderer": False, "use_camera_obs": False}
    stack = robosuite.make("Stack", robots="Panda", hard_reset=False, ignore_done=True, **settings)
    return RobosuiteEnv(stack, keys=KEYS)  # without relative positions, which would tell the truth


def towards(obs: dict[str, Any], goal: Any, grip: float) -> tuple[Any, float]:
    """The action that moves the hand to a position, world frame, m; and how far away it is, m."""
    away = goal - obs["robot0_eef_pos"]
    return np.concatenate([np.clip(GAIN * away, -1.0, 1.0), np.zeros(3), [grip]]), float(np.linalg.norm(away))


def reach(obs: dict[str, Any], memory: Any) -> tuple[Any, Any, bool]:
    """Above the cube, with open fingers."""
    action, away = towards(obs, obs["cubeA_pos"] + [0.0, 0.0, ABOVE_M], OPEN)
    return action, memory, away < 0.015


def grasp(obs: dict[str, Any], memory: Any) -> tuple[Any, Any, bool]:
    """Down, close, up; remembers how long the fingers have been closing."""
    closing = memory[0]
    action, away = towards(obs, obs["cubeA_pos"], OPEN)
    if closing or away < 0.012:
        closing += 1
        action = np.array([0.0, 0.0, 0.0 if closing < 8 else 0.8, 0.0, 0.0, 0.0, CLOSED])
    return action, np.array([closing]), closing > 18


def place(obs: dict[str, Any], memory: Any) -> tuple[Any, Any, bool]:
    """Above the other cube, down, open, up; remembers its phase and for how long."""
    phase, steps = memory[0], memory[1] + 1
    height = (ABOVE_M, ON_TOP_M, ON_TOP_M, 2 * ABOVE_M)[int(phase)]
    action, away = towards(obs, obs["cubeB_pos"] + [0.0, 0.0, height], CLOSED if phase < 2 else OPEN)
    if away < 0.012 if phase < 2 else steps > 6:
        phase, steps = phase + 1, 0
    return action, np.array([min(phase, 3.0), steps]), phase > 3


def failed(info: dict[str, Any], obs: dict[str, Any]) -> str | None:
    """What the fingers feel: nothing between them where there should be something."""
    closed = np.abs(obs["robot0_gripper_qpos"]).max() < EMPTY_M
    if info["controller"] == "grasp" and info["controller_step"] > 12 and closed:
        return "missed"
    if info["controller"] == "place" and info["controller_step"] < 4 and closed:
        return "dropped"
    return None


def world(sigma_m: float = 0.03, estimator: Mode = "halving", processes: int = 2) -> GymnasiumWorld:
    """The environment as a world.

    Args:
        sigma_m: of the estimated horizontal positions of the cubes at the start, m.
        estimator: how the error develops.
        processes: environments that work at the same time.
    """
    return GymnasiumWorld(
        "stack",
        make_env,
        [Controller("reach", reach, 60), Controller("grasp", grasp, 60, 1), Controller("place", place, 100, 2)],
        success=lambda info, obs: bool(info["success"]),
        primitives=box_primitives(0.5, 5, ["x", "y", "z", "rx", "ry", "rz", "grip"], keep=["rx", "ry", "grip"]),
        failed=failed,
        failures=["missed", "dropped"],
        noise=[Noise(sigma_m, ["cubeA_pos[0:2]"]), Noise(sigma_m, ["cubeB_pos[0:2]"])],
        estimator=estimator,
        position="robot0_eef_pos",
        mode_fields=["robot0_eef_pos - cubeA_pos", "robot0_gripper_qpos"],
        processes=processes,
    )

"""Two tasks of Meta-World with the scripted policies that come with it as nominal controllers.

The robot's estimate of the handle errs by some centimetres, so that the policy reaches beside it and pushes in vain.

    python -m stages.discover world=drawer_open --config-dir examples/conf
    python -m stages.discover world=door_open --config-dir examples/conf
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import gymnasium
import numpy as np

from p2l.contracts.estimator import Mode
from p2l.worlds.gymnasium import Controller, GymnasiumWorld, Noise, box_primitives

PATIENCE = 130  # control steps after which the robot notices that the task is not done; without error it takes 124


@dataclass(frozen=True)
class Task:
    """A task of Meta-World: the name of its policy's class, and how far the handle goes before the policy ends, m."""

    policy: str
    travel_m: float


TASKS = {"drawer-open-v3": Task("SawyerDrawerOpenV3Policy", 0.18), "door-open-v3": Task("SawyerDoorOpenV3Policy", 0.52)}


class Seeded(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Meta-World draws a task by a generator that `reset(seed)` leaves alone."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Handle and furniture are placed by `seed`; a step at rest, since the first observation shows the old ones."""
        if seed is not None:
            self.unwrapped.seed(seed)  # type: ignore[attr-defined]
        self.env.reset(seed=seed, options=options)
        obs, *_, info = self.env.step(np.zeros(4, dtype=np.float32))
        return obs, info


def make_env(task: str) -> Any:
    """One environment; its time limit is out of the way."""
    from metaworld.env_dict import ALL_V3_ENVIRONMENTS_GOAL_OBSERVABLE

    env = ALL_V3_ENVIRONMENTS_GOAL_OBSERVABLE[f"{task}-goal-observable"](seed=0, render_mode="rgb_array")
    env._freeze_rand_vec, env.seeded_rand_vec = False, True
    env.max_path_length = 5000
    env.camera_name = "corner2"
    return Seeded(env)


def act(task: str, obs: Any, memory: Any) -> tuple[Any, Any, bool]:
    """Meta-World's policy, until the handle has moved far enough; remembers where it was, and that it does."""
    import metaworld.policies

    handle = obs[4:7].copy()
    if not memory[0]:
        memory = np.append(1.0, handle)
    policy = getattr(metaworld.policies, TASKS[task].policy)()
    action = policy.get_action(obs.copy())
    travel = np.linalg.norm(handle - memory[1:])
    return np.clip(action, -1.0, 1.0), memory, bool(travel > TASKS[task].travel_m)


def failed(info: dict[str, Any], obs: Any) -> str | None:
    """What the robot notices: it has tried for long, and its drawer or door is not open."""
    late = info["controller"] == "policy" and info["controller_step"] >= PATIENCE
    return "stuck" if late and not info["success"] else None


def world(task: str, sigma_m: float = 0.04, estimator: Mode = "halving", processes: int = 2) -> GymnasiumWorld:
    """A task as a world.

    Args:
        task: one of `TASKS`.
        sigma_m: of the estimated position of the handle at the start, m.
        estimator: how the error develops.
        processes: environments that work at the same time.
    """
    return GymnasiumWorld(
        task,
        partial(make_env, task),
        [Controller("policy", partial(act, task), 250, 4)],
        success=lambda info, obs: bool(info["success"]),
        primitives=box_primitives(1.0, 8, ["x", "y", "z", "grip"], keep=["grip"]),
        failed=failed,
        failures=["stuck"],
        noise=[Noise(sigma_m, ["observation[4:7]", "observation[22:25]", "observation[36:39]"])],
        estimator=estimator,
        fields={"hand_pos_m": "observation[0:3]", "handle_pos_m": "observation[4:7]"},
        position="observation[0:3]",
        mode_fields=["hand_pos_m - handle_pos_m"],
        processes=processes,
    )

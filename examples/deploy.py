"""A learnt recovery at work where it was not learnt: no torch, and nothing of p2l.

    python -m stages.export policy=<folder> failures=<file> hydra.run.dir=outputs/exported
    python -m examples.deploy outputs/exported

The nominal controllers run until one of them ends badly; the policy decides, primitive by primitive, and hands control
back to a controller when it likes. Here in Gymnasium's own environment, with an error of the estimated object position.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime

from examples.fetch import skills

NOMINAL = {"reach": (skills.reach, 40), "grasp": (skills.grasp, 40), "move": (skills.move, 50)}
SIGMA_M, HELD_STEPS, STEP = 0.04, 4, 0.5
AXES = {f"{sign}{name}": (axis, size) for axis, name in enumerate("xyz") for sign, size in (("+", STEP), ("-", -STEP))}


class Robot:
    """One episode: what the robot sees, what it last did, how many actions it has finished."""

    def __init__(self, env: Any, seed: int) -> None:
        self.env, self.rng = env, np.random.default_rng(seed)
        self.truth, self.info = env.reset(seed=seed)
        self.last, self.actions, self.error = np.zeros(4), 0, SIGMA_M * self.rng.standard_normal(2)

    def seen(self) -> dict[str, Any]:
        """The observation, with the error of the estimate."""
        obs = {name: value.copy() for name, value in self.truth.items()}
        for part, where in (("observation", 3), ("observation", 6), ("achieved_goal", 0)):
            obs[part][where : where + 2] += self.error
        return obs

    def step(self, action: Any, controller: str, count: int) -> str | None:
        """One control step; what the detector says after it."""
        self.last = np.asarray(action, dtype=float)
        self.truth, *_, self.info = self.env.step(self.last.astype(np.float32))
        return skills.failed({**self.info, "controller": controller, "controller_step": count}, self.seen())

    def finish(self) -> None:
        """An action has ended: the next look is twice as good."""
        self.actions += 1
        self.error = SIGMA_M * 0.5**self.actions * self.rng.standard_normal(2)

    def state(self, columns: list[str]) -> Any:
        """[1, O] what the policy observes, in the order of its card."""
        whole = (obs := self.seen())["observation"]
        fields = {
            "grip_pos_m": whole[0:3],
            "object_pos_m": whole[3:6],
            "fingers_m": whole[9:11],
            "actions": [self.actions],
        }
        fields |= {"observation[6:9]": whole[6:9], "observation[11:25]": whole[11:], "last_action": self.last, **obs}
        parts = [column.rpartition("[") if column not in fields else (column, "", "0]") for column in columns]
        return np.array([[fields[name][int(index[:-1])] for name, _, index in parts]], dtype=np.float32)


def run_from(robot: Robot, first: str) -> str | None:
    """The nominal chain from a controller on; what the detector says, or None at the end."""
    for name in list(NOMINAL)[list(NOMINAL).index(first) :]:
        act, limit = NOMINAL[name]
        memory: Any = np.zeros(1)
        for count in range(limit):
            action, memory, done = act(robot.seen(), memory)
            if done:
                break
            if (flag := robot.step(action, name, count)) is not None:
                return flag
        robot.finish()
    return None


def recover(robot: Robot, session: Any, card: dict[str, Any]) -> bool:
    """The policy decides until it hands control back or its episode is over; whether the task is done then."""
    for _ in range(card["limits"]["decisions"]):
        [choice] = session.run(["action"], {"observation": robot.state(card["columns"])})[0]
        name = card["actions"][choice]
        if name.startswith("from "):
            run_from(robot, name.removeprefix("from "))
            break
        axis, size = AXES[name]
        action = np.append(np.zeros(3), robot.last[3])
        action[axis] = size
        for count in range(HELD_STEPS):
            robot.step(action, name, count)
        robot.finish()
    return skills.success(robot.info, robot.truth)


def main(folder: Path, episodes: int = 50) -> tuple[float, float]:
    """Print and return how often the task is done without and with the recovery."""
    session = onnxruntime.InferenceSession(folder / "policy.onnx", providers=["CPUExecutionProvider"])
    card = json.loads((folder / "policy.onnx.json").read_text())
    env, alone, together = skills.make_env(), 0, 0
    for seed in range(episodes):
        robot = Robot(env, seed)
        flag = run_from(robot, "reach")
        done = flag is None and skills.success(robot.info, robot.truth)
        alone += done
        if flag is not None:
            robot.finish()
            done = recover(robot, session, card)
        together += done
    print(f"{episodes} episodes: nominal {alone / episodes:.0%}, with recovery {together / episodes:.0%}")
    return alone / episodes, together / episodes


if __name__ == "__main__":
    main(Path(sys.argv[1]))

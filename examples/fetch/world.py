"""Gymnasium-Robotics' FetchPickAndPlace-v4 as a world: its skills are in `skills.py`.

The robot's estimate of the object errs by a few centimetres and gets better with every action; a grasp beside the
object is felt by the fingers, which close on nothing.

    python -m stages.discover world=fetch --config-dir examples/conf   # failures; then cluster, chain_recoveries, watch
"""

from __future__ import annotations

from examples.fetch.skills import failed, grasp, make_env, move, reach, success
from p2l.contracts.estimator import Mode
from p2l.worlds.gymnasium import Controller, GymnasiumWorld, Noise, box_primitives


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

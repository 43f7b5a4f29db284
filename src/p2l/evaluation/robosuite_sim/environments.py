"""robosuite's environments, made with its public constructor arguments only.

What is asked for, beside the task and the arm: no cameras, 20 Hz, no end of an episode (`ignore_done`), no noise in the
start posture (a row has its own), resets that keep the compiled model (`hard_reset=False`), and OSC_POSE as robosuite
configures it for the arm, but for two of its settings: targets are absolute poses in the world frame (`input_type`,
`input_ref_frame`) instead of displacements of at most 5 cm and 0.5 rad, and its gains are the caller's.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from p2l.errors import ConfigError
from p2l.evaluation.robosuite_sim.gains import Gains
from p2l.sim.scene import Scene
from p2l.worlds.robot import RobotWorld
from p2l.worlds.world import World

TASKS = {"door": "Door", "pick_place": "PickPlaceBread"}
CONTROL_HZ = 20
ARM = "Panda"


def known_tasks() -> dict[str, str]:
    """The environment of robosuite by name of our world, of those worlds that robosuite has itself."""
    return dict(sorted(TASKS.items()))


def scene_of(world: World) -> Scene:
    """The one scene of a world that robosuite has itself.

    Raises:
        ConfigError: robosuite has no such task, or the world has several models or another control period.
    """
    if world.name not in TASKS:
        raise ConfigError(f"robosuite has no task of its own for '{world.name}'; it has: {', '.join(known_tasks())}")
    if not isinstance(world, RobotWorld) or len(world.scenes) != 1:
        raise ConfigError(f"robosuite's own {TASKS[world.name]} has one scene; give a world with one model")
    if round(1.0 / world.engine.control_period_s) != CONTROL_HZ:
        raise ConfigError(f"robosuite is asked for actions at {CONTROL_HZ} Hz; the world has another control period")
    return world.scenes[0]


def environment(name: str, scene: Scene, gains: Gains) -> Any:
    """The robosuite environment that a world was made after.

    Args:
        name: one of `known_tasks`.
        scene: of the world.
        gains: of OSC_POSE.

    Raises:
        ConfigError: the scene is a variant that robosuite does not have: another arm, or a part of another size.
    """
    with _quiet():
        import robosuite

        controller = robosuite.load_composite_controller_config(robot=ARM)
        controller["body_parts"]["right"] |= {
            "input_type": "absolute",
            "input_ref_frame": "world",
            "kp": list(gains.kp),
            "damping_ratio": np.array(gains.damping_ratio),
        }
        made = robosuite.make(
            TASKS[name],
            robots=ARM,
            controller_configs=controller,
            initialization_noise=None,
            control_freq=CONTROL_HZ,
            ignore_done=True,
            hard_reset=False,
            has_renderer=False,
            has_offscreen_renderer=False,
            use_camera_obs=False,
            use_object_obs=False,
        )
    if other := _differences(made.sim.model, scene):
        made.close()
        raise ConfigError(
            f"robosuite's own {TASKS[name]} (with the {ARM}) differs from this world in {', '.join(other)}; "
            "give a world without such a variation"
        )
    return made


def _differences(theirs: Any, scene: Scene) -> list[str]:
    """Joints and named geoms of ours that robosuite's model does not have, or has in another size."""
    model = scene.model
    joints = [model.joint(index).name for index in range(model.njnt)]
    missing = [joint for joint in joints if joint not in theirs.joint_names]
    known = set(theirs.geom_names)
    geoms = [model.geom(index).name for index in range(model.ngeom) if model.geom(index).name in known]
    sizes = {name: theirs.geom_size[theirs.geom_name2id(name)] for name in geoms}
    return missing + [name for name in geoms if not np.allclose(model.geom(name).size, sizes[name], atol=1e-6)]


@contextmanager
def _quiet() -> Iterator[None]:
    """Without robosuite's messages about where it read its controller's settings."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        yield
    finally:
        logging.disable(before)

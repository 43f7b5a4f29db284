"""robosuite's environments, made with its public constructor arguments only, and the shelf's, which is written here.

The arguments beside the task and the arm: no cameras, 20 Hz, no end of an episode (`ignore_done`), no noise in the
start posture (a row has its own), resets that keep the compiled model (`hard_reset=False`), and OSC_POSE as robosuite
configures it for the arm, but for two of its settings: targets are absolute poses in the world frame (`input_type`,
`input_ref_frame`) instead of displacements of at most 5 cm and 0.5 rad, and its gains are the caller's.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np

from p2l.contracts.world import World
from p2l.errors import ConfigError
from p2l.sim.scene import Scene
from p2l.worlds.robosuite.gains import Gains
from p2l.worlds.robot import RobotWorld
from p2l.worlds.shelf.world import Shelf

TASKS = {"door": "Door", "pick_place": "PickPlaceBread"}
SHELF_TASKS = {"cluttered_shelf": "PlaceOnShelf", "shelf": "PlaceOnShelf"}  # in `worlds.robosuite.shelf`
CONTROL_HZ = 20
ARM = "Panda"


def known_tasks() -> dict[str, str]:
    """The environment of robosuite by name of our world, of those worlds that robosuite has itself."""
    return dict(sorted(TASKS.items()))


def task_of(name: str) -> str:
    """The environment, robosuite's own or ours for robosuite, by name of our world.

    Raises:
        ConfigError: there is neither.
    """
    if name not in TASKS | SHELF_TASKS:
        raise ConfigError(
            f"robosuite has no task of its own for '{name}'; it has: {', '.join(known_tasks())}; "
            f"written for it (p2l.worlds.robosuite): {', '.join(SHELF_TASKS)}"
        )
    return (TASKS | SHELF_TASKS)[name]


def scene_of(world: World) -> Scene:
    """The scene of a world that runs in robosuite too; the first of the shelf's, which differ in masses and sizes.

    Raises:
        ConfigError: there is no such task, or the world has several models and robosuite's own environment one, or
            another control period.
    """
    task = task_of(world.name)
    if not isinstance(world, RobotWorld) or (world.name in TASKS and len(world.scenes) != 1):
        raise ConfigError(f"robosuite's own {task} has one scene; give a world with one model")
    if round(1.0 / world.engine.control_period_s) != CONTROL_HZ:
        raise ConfigError(f"robosuite is asked for actions at {CONTROL_HZ} Hz; the world has another control period")
    return world.scenes[0]


def environment(world: World, scene: Scene, gains: Gains, *, objects: bool = False) -> Any:
    """The robosuite environment of a world's task.

    Args:
        world: whose task is meant.
        scene: of the world, see `scene_of`.
        gains: of OSC_POSE.
        objects: whether robosuite observes objects at each control step, which is its default.

    Raises:
        ConfigError: the scene is a variant that robosuite does not have: another arm, or a part of another size.
    """
    task = task_of(world.name)
    with _quiet():
        import robosuite

        from p2l.worlds.robosuite import shelf

        controller = robosuite.load_composite_controller_config(robot=ARM)
        controller["body_parts"]["right"] |= {
            "input_type": "absolute",
            "input_ref_frame": "world",
            "kp": list(gains.kp),
            "damping_ratio": np.array(gains.damping_ratio),
        }
        env = robosuite.make(
            task,
            robots=ARM,
            controller_configs=controller,
            initialization_noise=None,
            control_freq=CONTROL_HZ,
            ignore_done=True,
            hard_reset=False,
            has_renderer=False,
            has_offscreen_renderer=False,
            use_camera_obs=False,
            use_object_obs=objects,
            **(shelf.settings(world) if isinstance(world, Shelf) else {}),
        )
    if other := _differences(env.sim.model, scene.visual_model):
        env.close()
        raise ConfigError(
            f"robosuite's {task} (with the {ARM}) differs from this world in {', '.join(other)}; "
            "give a world without such a variation"
        )
    return env


def _differences(theirs: Any, model: mujoco.MjModel) -> list[str]:
    """Joints and named geoms of ours that robosuite's model does not have, or has in another size."""
    joints = [model.joint(index).name for index in range(model.njnt)]
    missing = [joint for joint in joints if joint not in theirs.joint_names]
    geom_names = set(theirs.geom_names)
    geoms = [model.geom(index).name for index in range(model.ngeom) if model.geom(index).name in geom_names]
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

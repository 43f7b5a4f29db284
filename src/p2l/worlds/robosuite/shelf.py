"""A thing from the table onto a shelf as an environment of robosuite, which has none of its own (thesis, 5.4.2, 5.4.3).

Written as robosuite's own Lift, Door and PickPlace are: its arena, its robot, objects of its classes, the same that
`worlds.shelf.scene` composes; start states drawn at a reset, where the shelf's two parts are moved as Door moves its
door; robosuite does all else. Nothing of ours runs in a step but the reward.

Masses, and the sizes of the clutter, are those that the objects are made with until somebody sets others in the model,
as `mirror.Mirror` does for rows of our world.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

import numpy as np
from robosuite.environments.manipulation.manipulation_env import ManipulationEnv
from robosuite.models.arenas import TableArena
from robosuite.models.objects import BoxObject
from robosuite.models.tasks import ManipulationTask
from robosuite.utils.observables import Observable, sensor
from robosuite.utils.transform_utils import convert_quat

from p2l.records import Array
from p2l.worlds.shelf.hold import UPRIGHT, UPRIGHT_QUAT, turn_rad, upright_distance
from p2l.worlds.shelf.scene import CLUTTER, INNER_WIDTH_M, TABLE_FULL_M, TABLE_M, Thing, shelf_parts
from p2l.worlds.shelf.starts import Starts
from p2l.worlds.shelf.world import AWAY_M, REST_M_S, TARGET_M, Shelf


class PlaceOnShelf(ManipulationEnv):
    """Success: the thing at rest on the shelf, upright, near its middle, the hand open and away, no clutter turned.

    Args:
        robots: robosuite's name of the arm.
        thing: what is placed.
        starts: where things stand after a reset.
        clutter_half_m: [3] half sizes of each box that stands on the shelf; two, or none.
        clutter_density: kg/m³.
        clutter_limit_rad: turn of a box above which the task has failed.
        impratio: of contacts, see `sim.scene.Physics`; with robosuite's 20 what is held turns in the hand.
        use_object_obs: whether poses of thing, shelf and clutter are observed.
        reward_scale: reward of a control step that ends in success; 0 of all others.
        settings: those of `ManipulationEnv`.
    """

    def __init__(
        self,
        robots: str,
        thing: Thing,
        starts: Starts,
        clutter_half_m: Sequence[Sequence[float]] = (),
        clutter_density: float = 100.0,
        clutter_limit_rad: float = 0.1,
        impratio: float = 20.0,
        use_object_obs: bool = True,
        reward_scale: float = 1.0,
        **settings: Any,
    ) -> None:
        self.thing, self.starts = thing, starts
        self.clutter_half_m = np.array(clutter_half_m).reshape(-1, 3)
        self.clutter_density, self.clutter_limit_rad = clutter_density, clutter_limit_rad
        self.impratio = impratio
        self.use_object_obs, self.reward_scale = use_object_obs, reward_scale
        super().__init__(robots=robots, **settings)

    def reward(self, action: Array | None = None) -> float:  # noqa: ARG002 (robosuite's signature)
        """`reward_scale` in success, else 0."""
        return self.reward_scale * float(self._check_success())

    def _load_model(self) -> None:
        super()._load_model()
        robot = self.robots[0].robot_model
        robot.set_base_xpos(robot.base_xpos_offset["table"](TABLE_FULL_M[0]))
        arena = TableArena(table_full_size=TABLE_FULL_M, table_offset=(0.0, 0.0, TABLE_M))
        arena.set_origin([0, 0, 0])
        self.object = self.thing.make()
        self.clutter = [
            BoxObject(name, size=half, density=self.clutter_density, rgba=[0.25, 0.45, 0.7, 1.0])
            for name, half in zip(CLUTTER, self.clutter_half_m, strict=False)
        ]
        self.lower, self.upper = shelf_parts()
        objects = [self.object, *self.clutter, self.lower, self.upper]
        self.model = ManipulationTask(mujoco_arena=arena, mujoco_robots=[robot], mujoco_objects=objects)
        self.model.root.find("option").set("impratio", str(self.impratio))

    def _setup_references(self) -> None:
        super()._setup_references()
        body = self.sim.model.body_name2id
        self.object_body_id, self.clutter_body_ids = (
            body(self.object.root_body),
            [body(box.root_body) for box in self.clutter],
        )
        self.lower_body_id, self.upper_body_id = body(self.lower.root_body), body(self.upper.root_body)
        first = self.sim.model.get_joint_qvel_addr(self.object.joints[0])[0]
        self.object_velocity = slice(first, first + 3)

    def _reset_internal(self) -> None:
        super()._reset_internal()
        if self.deterministic_reset:
            return
        layouts = self.starts.draw(self.rng, 1)
        self.sim.model.body_pos[self.lower_body_id] = layouts.floor_m[0]
        self.sim.model.body_pos[self.upper_body_id] = layouts.roof_m[0]
        height = TABLE_M + self.thing.bottom_m
        places = [(self.object, np.array([*layouts.object_m[0], height]))]
        if self.clutter:
            places += zip(self.clutter, layouts.clutter_pos_m(self._clutter_sizes()[None, :, 1:])[0], strict=True)
        for thing, place in places:
            self.sim.data.set_joint_qpos(thing.joints[0], np.concatenate([place, UPRIGHT_QUAT]))

    def _clutter_sizes(self) -> Array:
        model = self.sim.model
        return np.array([model.geom_size[model.geom_name2id(box.contact_geoms[0])] for box in self.clutter])

    def _setup_observables(self) -> OrderedDict[str, Observable]:
        observables: OrderedDict[str, Observable] = super()._setup_observables()
        if not self.use_object_obs:
            return observables
        modality = "object"
        sensors = [self._position("shelf_pos", self.lower_body_id)]
        bodies = [("object", self.object_body_id), *zip(CLUTTER, self.clutter_body_ids, strict=False)]
        for name, body in bodies:
            sensors += [self._position(f"{name}_pos", body), self._orientation(f"{name}_quat", body)]
        short = self._get_arm_prefixes(self.robots[0], include_robot_name=False)
        for prefix, full in zip(short, self._get_arm_prefixes(self.robots[0]), strict=True):
            sensors.append(self._get_obj_eef_sensor(full, "object_pos", f"{prefix}gripper_to_object_pos", modality))
        for one in sensors:
            observables[one.__name__] = Observable(name=one.__name__, sensor=one, sampling_rate=self.control_freq)
        return observables

    def _position(self, name: str, body: int) -> Any:
        @sensor(modality="object")
        def read(_: Any) -> Array:
            return np.array(self.sim.data.body_xpos[body])

        read.__name__ = name
        return read

    def _orientation(self, name: str, body: int) -> Any:
        @sensor(modality="object")
        def read(_: Any) -> Array:
            return np.asarray(convert_quat(np.array(self.sim.data.body_xquat[body]), to="xyzw"))

        read.__name__ = name
        return read

    def visualize(self, vis_settings: dict[str, bool]) -> None:
        """As robosuite's, with the grip site coloured by its distance to the thing."""
        super().visualize(vis_settings=vis_settings)
        if vis_settings["grippers"]:
            self._visualize_gripper_to_target(gripper=self.robots[0].gripper, target=self.object)

    def _check_success(self) -> bool:
        data, robot = self.sim.data, self.robots[0]
        place = data.body_xpos[self.object_body_id]
        target = data.body_xpos[self.lower_body_id] + [0.0, -self.thing.place_before_m, self.thing.bottom_m]
        off = np.abs(place - target)
        if off[0] >= INNER_WIDTH_M / 2 - self.thing.half_width_m or max(off[1:]) >= TARGET_M:
            return False
        rests = np.linalg.norm(data.qvel[self.object_velocity]) < REST_M_S
        upright = upright_distance(data.body_xquat[[self.object_body_id]])[0] < UPRIGHT
        away = np.linalg.norm(data.site_xpos[robot.eef_site_id["right"]] - place) >= AWAY_M
        gap = np.abs(data.qpos[robot._ref_gripper_joint_pos_indexes["right"]]).sum()
        turns = turn_rad(data.body_xquat[self.clutter_body_ids]) > self.clutter_limit_rad
        hand_open = gap > 2.0 * self.thing.half_width_m + 0.01
        return bool(rests and upright and away and hand_open and not turns.any())


def settings(world: Shelf) -> dict[str, Any]:
    """What `PlaceOnShelf` needs to be the task of a world; clutter in the largest size of the world's models."""
    sizes = world.scenes[0].visual_model  # of the largest clutter, see `worlds.shelf.scene.Bank`
    joints = [sizes.joint(name) for name in world.bank.clutter_joints]
    halves = [sizes.geom_size[int(sizes.body_geomadr[int(sizes.jnt_bodyid[joint.id])])].tolist() for joint in joints]
    return {
        "thing": world.thing,
        "starts": world.starts,
        "clutter_half_m": halves,
        "clutter_limit_rad": world.clutter_limit_rad,
        "impratio": world.scenes[0].physics.impratio,
    }

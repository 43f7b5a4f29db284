"""robosuite's door with a latch: grasp the handle, rotate it, pull the door open (thesis, section 4.4).

Deviations from the thesis and its author's settings, each where they are silent or cannot be kept:
1. The door stands on the robot's right (y negative), as robosuite's own does; the author's y of 0.25–0.30 m counts to
   that side.

Axis letters: N rows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
import numpy.typing as npt
from robosuite.models.arenas import TableArena
from robosuite.models.objects import DoorObject

from p2l.errors import ConfigError
from p2l.records import Array, BoolArray, IntArray
from p2l.sim.batch import Chunk
from p2l.sim.posture import reach
from p2l.sim.scene import WRIST_FORCE, Parts, Physics, Scene, build
from p2l.skills import poses
from p2l.worlds.estimator import Estimator, Mode
from p2l.worlds.handles import DOOR, Handle, find, shape
from p2l.worlds.robot import RobotWorld
from p2l.worlds.world import NO_FAILURE, Command, Rows

BASE_POS_WORLD = (-0.56, 0.0, 0.0)
FURNITURE = f"{DOOR}_main"
OPEN_RAD = 0.3
START_AWAY_M = 0.15
GRASP_INWARD_M = 0.035
PAD_HALF_M = 0.008
KINDS = ("missed_handle", "slip_rotating", "slip_pulling", "force")


class Door(RobotWorld):
    """The door; every parameter is a plain value of its YAML.

    Args:
        arm: robosuite's name of the arm.
        handle: one of `worlds.handles.HANDLES`, or a list of them from which each row draws.
        estimator: how the estimate of the handle's position errs.
        sigma_m: its standard deviation in x, y and z, m.
        x_m, y_m, z_m: ranges of the door's position from the robot's base, m; y to the robot's right.
        yaw_rad: range of the door's yaw about facing the robot's left, rad.
        joint_noise_rad: standard deviation of the start posture.
        force_limit_n: wrist force above which a failure is flagged.
        timestep_s: physics time step.
        nthread: simulator threads.
    """

    failure_kinds = KINDS
    memory_size = 3  # control steps that the fingers have been told to close; held before; turned while held

    def __init__(
        self,
        *,
        arm: str = "Panda",
        handle: str | int | Sequence[str | int] = "1",
        estimator: Mode = "fixed",
        sigma_m: float = 0.02,
        x_m: Sequence[float] = (0.35, 0.42),
        y_m: Sequence[float] = (0.25, 0.30),
        z_m: Sequence[float] = (0.20, 0.25),
        yaw_rad: Sequence[float] = (-0.26, 0.26),
        joint_noise_rad: float = 0.0,
        force_limit_n: float = 60.0,
        timestep_s: float = 0.005,
        nthread: int = 2,
    ) -> None:
        params = {name: value for name, value in locals().items() if name not in ("self", "nthread", "__class__")}
        named = find(handle)
        self.handles = tuple(one for _, one in named)
        self.ranges = _ranges(x_m=x_m, y_m=y_m, z_m=z_m, yaw_rad=yaw_rad)
        self.force_limit_n, self.joint_noise_rad = force_limit_n, joint_noise_rad
        scenes = [_scene(arm, one, timestep_s) for one in self.handles]
        super().__init__("door", params, scenes, Estimator(estimator, (sigma_m,) * 3), nthread=nthread)
        self.base_pos_m = np.array(scenes[0].model.body("robot0_base").pos)
        self.finger_sign = 1.0
        self._start = self._start_posture()

    def sample(self, rng: np.random.Generator, n: int) -> Rows:
        """N closed doors, the arm in its start posture, fingers open."""
        low, high = np.array(list(self.ranges.values())).T
        pose = self.door_pose(rng.uniform(low, high, (n, 4)))
        qpos = np.zeros((n, self.engine.nq))
        arm = self._start + self.joint_noise_rad * rng.standard_normal((n, len(self._start)))
        qpos[:, [column - 1 for column in self._arm]] = arm
        for joint, column in self._columns.items():
            if "finger_joint" in joint:
                qpos[:, column - 1] = 0.04 if joint.endswith("1") else -0.04
        model = rng.integers(len(self.handles), size=n)
        return self.rows(qpos, self.estimator.draw(rng, n), model=model, furniture={FURNITURE: pose})

    def door_pose(self, place: Array) -> Array:
        """[N, 7] pose of the door from x, y, z (m from the robot's base, y to its right) and yaw (rad)."""
        pos = self.base_pos_m + place[:, :3] * [1.0, -1.0, 1.0]
        return np.concatenate([pos, poses.quat(poses.about([0.0, 0.0, 1.0], place[:, 3] - np.pi / 2))], axis=1)

    def _start_posture(self) -> Array:
        middle = np.array([sum(pair) / 2 for pair in self.ranges.values()])[None]
        rows = self.rows(
            np.zeros((1, self.engine.nq)),
            np.zeros((1, 1, 3)),
            furniture={FURNITURE: self.door_pose(middle)},
        )
        pos, quat, out = grasp_pose(self.read(rows, "handle_pos"), self.read(rows, "handle_quat"), self.finger_sign)
        found = reach(self.scenes[0], (pos - START_AWAY_M * out)[0], quat[0])
        if found is None:
            raise ConfigError("door: no posture of the arm starts in front of the handle")
        return found

    def _truth(self, rows: Rows) -> Mapping[str, npt.NDArray[np.generic]]:
        return self._body(rows) | {
            "handle_pos_m": self.read(rows, "handle_pos"),
            "handle_quat": self.read(rows, "handle_quat"),
            "grip_in_handle_m": self._in_handle(rows),
            "hinge_rad": self.joint(rows, f"{DOOR}_hinge"),
            "latch_rad": self.joint(rows, f"{DOOR}_latch_joint"),
            "held": self.held(rows),
            "force_n": np.linalg.norm(self.read(rows, WRIST_FORCE), axis=1),
        }

    def _seen(self, rows: Rows, error: Array) -> Mapping[str, npt.NDArray[np.generic]]:
        return self._body(rows) | {
            "handle_pos_m": self.read(rows, "handle_pos") + error,
            "handle_quat": self.read(rows, "handle_quat"),
            "force_high": np.linalg.norm(self.read(rows, WRIST_FORCE), axis=1) > self.force_limit_n,
            "actions": rows.actions,
        }

    def _body(self, rows: Rows) -> dict[str, npt.NDArray[np.generic]]:
        target = rows.states[:, self.engine.physics_size : self.engine.physics_size + 7]
        return {
            "grip_pos_m": self.read(rows, "grip_pos"),
            "grip_quat": self.read(rows, "grip_quat"),
            "target_pos_m": target[:, :3],
            "target_quat": target[:, 3:],
            "gap_m": self.gap_m(rows),
            "arm_rad": self.arm(rows),
        }

    def _in_handle(self, rows: Rows) -> Array:
        """[N, 3] of the grip site in the lever's frame: from the axis outward, from its middle into the door, across; m."""
        lever = np.array([one.site_m for one in self.handles])[rows.model]
        away = self.read(rows, "grip_pos") - self.read(rows, "handle_pos")
        inside = poses.rotation(self.read(rows, "handle_quat")).inv().apply(away)
        return np.asarray(inside + np.stack([lever, np.zeros_like(lever), np.zeros_like(lever)], axis=1))

    def held(self, rows: Rows) -> BoolArray:
        """[N] whether the lever is between the fingers' pads, and they are about as far apart as it is thick."""
        at = self._in_handle(rows)
        size = np.array([[one.length_m, one.depth_m, one.thickness_m] for one in self.handles])[rows.model]
        along = (at[:, 0] > 0.0) & (at[:, 0] < size[:, 0] + PAD_HALF_M)
        deep = np.abs(at[:, 1]) < size[:, 1] / 2 + PAD_HALF_M
        across = np.abs(at[:, 2]) < size[:, 2] / 2
        gap = self.gap_m(rows)
        return np.asarray(along & deep & across & (gap > size[:, 2] - 0.005) & (gap < size[:, 2] + 0.02))

    def monitor(self, before: Rows, after: Rows, chunk: Chunk, command: Command) -> tuple[IntArray, Array]:
        """The detectors; see `KINDS`."""
        closed = np.where(command.grip > 0.5, before.memory[:, 0] + 1.0, 0.0)
        held = self.held(after) & (closed > 0)
        was = (before.memory[:, 1] > 0) & (closed > 0)
        turned = (before.memory[:, 2] > 0) & (closed > 0)
        turned |= held & (self.joint(after, f"{DOOR}_latch_joint") > 1.0)
        kind = np.full(len(after), NO_FAILURE, dtype=np.int64)
        kind[self.peak_force_n(chunk, WRIST_FORCE) > self.force_limit_n] = KINDS.index("force")
        kind[was & ~held & turned] = KINDS.index("slip_pulling")
        kind[was & ~held & ~turned] = KINDS.index("slip_rotating")
        kind[~was & ~held & (closed == 12)] = KINDS.index("missed_handle")
        return kind, np.stack([closed, held | was, turned], axis=1).astype(np.float64)

    def goal(self, rows: Rows) -> BoolArray:
        """Hinge at 0.3 rad or more, as robosuite has it."""
        return self.joint(rows, f"{DOOR}_hinge") >= OPEN_RAD


def grasp_pose(handle_pos: Array, handle_quat: Array, finger_sign: float) -> tuple[Array, Array, Array]:
    """Where the nominal grasp holds a lever: position [N, 3], orientation [N, 4], and the approach's direction [N, 3].

    Args:
        handle_pos: [N, 3] world frame, m.
        handle_quat: [N, 4] of the lever's frame: x outward from the axis, y into the door.
        finger_sign: which of the two equivalent orientations of the fingers.
    """
    lever = poses.rotation(handle_quat)
    into = lever.apply([0.0, 1.0, 0.0])
    quat = poses.frame(lever.apply([0.0, 0.0, finger_sign]), into)
    return handle_pos - lever.apply([GRASP_INWARD_M, 0.0, 0.0]), quat, into


def _scene(arm: str, handle: Handle, timestep_s: float) -> Scene:
    arena = TableArena(table_full_size=(0.8, 0.3, 0.05), table_offset=(-0.2, -0.35, 0.8))
    arena.set_origin([0, 0, 0])
    door = DoorObject(name=DOOR, friction=0.0, damping=0.1, lock=True)
    tracked = {"handle": f"{DOOR}_handle"}
    parts = Parts(arena, [door], BASE_POS_WORLD, furniture=(FURNITURE,), tracked=tracked, edit=shape(handle))
    return build(arm, parts, Physics(timestep_s=timestep_s, damping_linear=80.0, damping_angular=5.0))


def _ranges(**given: Sequence[float]) -> dict[str, tuple[float, float]]:
    checked = {}
    for name, pair in given.items():
        if len(pair) != 2 or not np.isfinite(pair).all() or pair[0] > pair[1]:
            raise ConfigError(f"door: {name} must be [low, high] with low ≤ high, got {list(pair)}")
        checked[name] = (float(pair[0]), float(pair[1]))
    return checked


def corners(ranges: Mapping[str, tuple[float, float]]) -> Array:
    """[16, 4] extreme places of the door."""
    return np.array(list(product(*ranges.values())))

"""robosuite's single bread task: out of one bin and into the bread's quarter of another (thesis, section 5.4.1).

The hand is wider than the fingers, so where the bread lies close to a wall it meets the wall's edge before the fingers
hold the bread; the nominal skills know nothing of walls.

Deviations from robosuite's task and the thesis, each where the thesis is silent or cannot be kept:
1. `y_m` is wider than robosuite's own ±0.165 m (whose sampler keeps 7.5 cm from the walls): the thesis tells only that
   the bread "is initialized in a different location in the source bin in every episode", and the width is calibrated to
   its 70 % of nominal success.
2. The other three objects of robosuite's scene, which it moves out of sight, are left out.

Axis letters: N rows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
import numpy.typing as npt
from robosuite.models.arenas import BinsArena
from robosuite.models.objects import BreadObject

from p2l import poses
from p2l.contracts.estimator import Estimator, Mode
from p2l.contracts.observation import Privileged
from p2l.contracts.option import Option
from p2l.contracts.rows import Command, Rows
from p2l.contracts.world import NO_FAILURE, View
from p2l.errors import ConfigError
from p2l.records import Array, BoolArray, IntArray
from p2l.sim.batch import Chunk
from p2l.sim.posture import reach
from p2l.sim.scene import WRIST_FORCE, Parts, build
from p2l.worlds.felt import FELT_SIZE, felt_force
from p2l.worlds.physics import EVEN, PLAIN, VERSION, physics_of
from p2l.worlds.pick_place.bins import (
    BIN1_POS_M,
    BIN2_POS_M,
    BIN_INNER_HALF_M,
    BIN_SIZE_M,
    DOWN,
    FLOOR_M,
    LIFT_M,
    QUARTER_M,
    hand_room,
)
from p2l.worlds.pick_place.skills import options, quarter_turn
from p2l.worlds.robot import RobotWorld

BASE_POS_WORLD = (-0.5, -0.1, 0.0)  # robosuite's offset of the base for arenas with bins
REST_M = 0.8433  # height of the bread's centre when it lies there
BREAD_RADIUS_M = 0.0313  # half of its diagonal, seen from above
GRIP_START_M = 0.020833  # robosuite's start position of each finger
RELEASED_M = float(np.arctanh(0.4) / 10.0)  # robosuite: 1 − tanh(10 · distance) < 0.6 between grip site and object
EMPTY_GAP_M = 0.01  # closed fingers that hold nothing
LIFTED_M = 0.03  # the hand has risen by so much since it closed
CARRIED_M = 0.05  # bread that is higher above the floor is in the hand
MOVED_M = 0.01  # half of a primitive
# At the Panda's start posture robosuite's OSC (kp 150, shaped by the inertia, in which the motors' armatures count) is
# as stiff as 1800–6300 N/m and 140–2000 N·m/rad; the joints' damping keeps the elbow quiet at the far side of the bin.
IMPEDANCE = {
    "stiffness_linear": 3000.0,
    "damping_linear": 500.0,
    "stiffness_angular": 150.0,
    "damping_angular": 25.0,
    "joint_damping": 5.0,
}
KINDS = ("collision", "dropped")
_GRASP_HEIGHT, _FORCE = range(2)  # of the memory: height of the hand at the close command, m; is the force high
_FELT = slice(2, None)

THESIS_FIELDS = (  # the 46 numbers of the thesis's observation: robosuite's proprioception and object state
    "arm_cos",
    "arm_sin",
    "arm_vel_rad_s",
    "grip_pos_m",
    "grip_quat",
    "finger_pos_m",
    "finger_vel_m_s",
    "object_pos_m",
    "object_quat",
    "object_in_grip_m",
    "object_in_grip_quat",
)


class PickPlace(RobotWorld):
    """The bread task; every parameter is a plain value of its YAML.

    Args:
        arm: robosuite's name of the arm.
        estimator: how the estimate of the bread's position errs; the thesis has none here.
        sigma_m: its standard deviation in x, y and z, m.
        x_m, y_m: ranges of the bread's place from the middle of its bin, m.
        wall_clearance_m: the bread's centre stays at least so far from the walls, whatever the ranges, m.
        yaw_rad: range of the bread's yaw, rad.
        joint_noise_rad: standard deviation of each joint about robosuite's start posture, rad.
        force_limit_n: wrist force above which a collision is flagged, N.
        gain_scale: factor on the stiffness of the hand's impedance.
        friction_scale: factor on the friction of everything.
        axis_scale, impratio, air_density, joint_damping, armature_scale: along and about which axes the hand is
            stiffer, how much a grip gives way, and what a motion meets, see `worlds.physics.physics_of`.
        timestep_s: physics time step.
        version: of the physics, see `worlds.physics.VERSIONS`.
        nthread: simulator threads.

    Raises:
        ConfigError: a range that is reversed or leads into a wall, or places that the arm does not reach.
    """

    failure_kinds = KINDS
    mode_fields = ("object_pos_m", "grip_pos_m - object_pos_m", "gap_m", "hand_room_m")
    view = View(azimuth_deg=160.0, elevation_deg=-35.0, distance_m=1.3, lookat_m=(0.1, 0.0, 0.9))

    def __init__(
        self,
        *,
        arm: str = "Panda",
        estimator: Mode = "exact",
        sigma_m: float = 0.0,
        x_m: Sequence[float] = (-0.115, 0.115),
        y_m: Sequence[float] = (-0.196, 0.196),
        wall_clearance_m: float = 0.04,
        yaw_rad: Sequence[float] = (0.0, 2 * np.pi),
        joint_noise_rad: float = 0.02,
        force_limit_n: float = 50.0,
        gain_scale: float = 1.0,
        friction_scale: float = 1.0,
        axis_scale: Sequence[float] = EVEN,
        impratio: float | None = None,
        air_density: float = 0.0,
        joint_damping: float | None = None,
        armature_scale: float = 1.0,
        timestep_s: float = 0.005,
        version: int = VERSION,
        nthread: int = 2,
    ) -> None:
        params = {name: value for name, value in locals().items() if name not in ("self", "nthread", "__class__")}
        self._low, self._high = _ranges(wall_clearance_m, x_m=x_m, y_m=y_m, yaw_rad=yaw_rad)
        if joint_noise_rad < 0.0 or force_limit_n <= 0.0:
            raise ConfigError(
                "pick_place: joint_noise_rad must be at least 0 and force_limit_n above 0, "
                f"got {joint_noise_rad} and {force_limit_n}"
            )
        self._noise_rad, self.force_limit_n = joint_noise_rad, force_limit_n
        self.memory_size = 2 + (FELT_SIZE if version > 1 else 0)
        arena, bread = BinsArena(bin1_pos=BIN1_POS_M), BreadObject(name="Bread")
        arena.set_origin([0, 0, 0])
        parts = Parts(arena, [bread], BASE_POS_WORLD, pose_sensors={"object": bread.root_body})
        scene = build(
            arm,
            parts,
            physics_of(version, IMPEDANCE | {"timestep_s": timestep_s}, **{name: params[name] for name in PLAIN}),
        )
        super().__init__("pick_place", params, [scene], Estimator(estimator, (sigma_m,) * 3), nthread=nthread)
        self._dofs = np.array([int(scene.model.joint(joint).dofadr[0]) for joint in scene.arm_joints])
        self._fingers_at = [joint for joint in self._columns if "finger_joint" in joint]
        self._finger_dofs = np.array([int(scene.model.joint(joint).dofadr[0]) for joint in self._fingers_at])
        self._bread_at = self._columns[bread.joints[0]] - 1
        self._check_reach()
        self.observe_hand_as([0.0, 1.0, 1.0, 0.0])  # fingers down, as the Panda's joints put it

    def sample(self, rng: np.random.Generator, n: int) -> Rows:
        """N breads at rest anywhere in their bin, the arm near its start posture, fingers half open."""
        qpos = np.zeros((n, self.engine.nq))
        arm = self.scenes[0].home + self._noise_rad * rng.standard_normal((n, len(self._arm)))
        qpos[:, [column - 1 for column in self._arm]] = arm
        for joint in self._fingers_at:
            qpos[:, self._columns[joint] - 1] = GRIP_START_M if joint.endswith("1") else -GRIP_START_M
        at = self._bread_at
        place = rng.uniform(self._low, self._high, (n, 3))
        qpos[:, at : at + 2] = BIN1_POS_M[:2] + place[:, :2]
        qpos[:, at + 2] = REST_M
        qpos[:, at + 3 : at + 7] = poses.quat(poses.about([0.0, 0.0, 1.0], place[:, 2]))
        return self.rows(qpos, self.estimator.draw(rng, n))

    def _truth(self, rows: Rows) -> Mapping[str, npt.NDArray[np.generic]]:
        body = self._body(rows)
        pos = self.read(rows, "object_pos")
        return body | {
            "object_pos_m": pos,
            "object_quat": self.read(rows, "object_quat"),
            "object_in_grip_m": poses.image(poses.inverse(poses.unit(body["grip_quat"])), pos - body["grip_pos_m"]),
            "hand_room_m": hand_room(pos, np.asarray(body["grip_quat"])),
            "force_n": np.linalg.norm(self.read(rows, WRIST_FORCE), axis=1),
        }

    def _observation(self, rows: Rows, error: Array) -> Mapping[str, npt.NDArray[np.generic]]:
        body = self._body(rows)
        arm, pos = self.arm(rows), self.read(rows, "object_pos") + error
        velocity = self.engine.qvel(rows.states)
        hand, quat = poses.inverse(poses.unit(body["grip_quat"])), self.read(rows, "object_quat")
        seen = body | {
            "arm_cos": np.cos(arm),
            "arm_sin": np.sin(arm),
            "arm_vel_rad_s": velocity[:, self._dofs],
            "finger_pos_m": rows.states[:, self._finger_columns],
            "finger_vel_m_s": velocity[:, self._finger_dofs],
            "object_pos_m": pos,
            "object_quat": quat,
            "object_in_grip_m": poses.image(hand, pos - body["grip_pos_m"]),
            "object_in_grip_quat": poses.canonical(poses.product(hand, poses.unit(quat))),
            "force_high": rows.memory[:, _FORCE],
            "actions": rows.actions,
        }
        if self.version == 1:
            return seen
        return seen | {
            "object_off_hand_m": pos - body["grip_pos_m"],
            "object_to_quarter_m": QUARTER_M - pos,
            "hand_to_target_m": self.target(rows)[:, :3] - body["grip_pos_m"],
            "felt_force": rows.memory[:, _FELT],
        }

    def _body(self, rows: Rows) -> dict[str, Array]:
        return {
            "grip_pos_m": self.read(rows, "grip_pos"),
            "grip_quat": self.read(rows, "grip_quat"),
            "gap_m": self.gap_m(rows),
        }

    def monitor(self, before: Rows, after: Rows, chunk: Chunk, command: Command) -> tuple[IntArray, Array]:
        """A collision: wrist force above its limit. A dropped bread: a closed hand that has risen, and is empty."""
        height = self.read(after, "grip_pos")[:, 2]
        close_command = command.grip > 0.5
        grasp_height = np.where(close_command & (before.grip > 0.5), before.memory[:, _GRASP_HEIGHT], height)
        high = self.peak_force_n(chunk, WRIST_FORCE) > self.force_limit_n
        empty = close_command & (height - grasp_height > LIFTED_M) & (self.gap_m(after) <= EMPTY_GAP_M)
        kind = np.full(len(after), NO_FAILURE, dtype=np.int64)
        kind[empty] = KINDS.index("dropped")
        kind[high] = KINDS.index("collision")
        memory = np.stack([grasp_height, high], axis=1).astype(np.float64)
        if self.version > 1:
            wrist = self.engine.sensor(chunk, WRIST_FORCE).mean(axis=1)
            memory = np.concatenate([memory, felt_force(before.memory[:, _FELT], wrist)], axis=1)
        return kind, memory

    def goal(self, rows: Rows) -> BoolArray:
        """The test of robosuite: the bread in its quarter and low, and the hand away from it."""
        pos = self.read(rows, "object_pos")
        low = BIN2_POS_M - np.array([0.0, BIN_SIZE_M[1] / 2, 0.0])
        high = BIN2_POS_M + np.array([BIN_SIZE_M[0] / 2, 0.0, 0.1])
        away = np.linalg.norm(pos - self.read(rows, "grip_pos"), axis=1) > RELEASED_M
        return np.asarray(((low < pos) & (pos < high)).all(axis=1) & away)

    def nominal_options(self) -> tuple[Option, ...]:
        """Go to the grasp, pick, go to the goal, place; the same for every arm."""
        return options()

    def delivery_pos(self, truth: Privileged) -> Array:
        """The middle of the bread's quarter."""
        return np.tile(QUARTER_M, (len(truth), 1))

    def strategies(self, before: Rows, after: Rows) -> dict[str, BoolArray]:
        """By which strategies recoveries got out (thesis, section 5.4.1).

        Returns:
            `turn`: the orientation that the nominal skills would keep is a quarter turn about the vertical off the one
            at the failure (half turns are the same to the fingers). `push`: the bread still lies in its bin, and its
            distance to the nearest wall has grown by more than `MOVED_M`.
        """
        axes = [
            poses.rotate(poses.rotation(quarter_turn(self.observe(rows))), [1.0, 0.0, 0.0])[:, :2]
            for rows in (before, after)
        ]
        pos = [self.read(rows, "object_pos") for rows in (before, after)]
        room = [(BIN_INNER_HALF_M - np.abs(one[:, :2] - BIN1_POS_M[:2])).min(axis=1) for one in pos]
        lies = pos[1][:, 2] < FLOOR_M + CARRIED_M
        return {
            "turn": np.abs((axes[0] * axes[1]).sum(axis=1)) < 0.5,
            "push": lies & (room[1] - room[0] > MOVED_M),
        }

    def _check_reach(self) -> None:
        sides = zip(self._low[:2], self._high[:2], strict=True)
        corners = [np.array([*(BIN1_POS_M[:2] + corner), LIFT_M]) for corner in product(*sides)]
        down = poses.frame(np.array([[0.0, 1.0, 0.0]]), np.array([DOWN]))[0]
        places = [*corners, QUARTER_M + [0.0, 0.0, 0.2]]
        scene = self.scenes[0]
        if far := [place for place in places if reach(scene, place, down, starts=[scene.home]) is None]:
            where = "; ".join(", ".join(f"{value:.3f}" for value in place) for place in far)
            raise ConfigError(
                f"pick_place: the arm has no posture with the hand facing down at {where} (world, m); "
                "narrow x_m and y_m or choose another arm"
            )


def _ranges(clearance_m: float, **pairs: Sequence[float]) -> tuple[Array, Array]:
    if not BREAD_RADIUS_M <= clearance_m <= BIN_INNER_HALF_M.min():
        interval = f"[{BREAD_RADIUS_M}, {BIN_INNER_HALF_M.min()}]"
        raise ConfigError(f"pick_place: wall_clearance_m must lie in {interval}, got {clearance_m}")
    room = dict(zip(("x_m", "y_m"), (BIN_INNER_HALF_M - clearance_m).tolist(), strict=True))
    for name, pair in pairs.items():
        if len(pair) != 2 or not np.isfinite(pair).all() or pair[0] > pair[1]:
            raise ConfigError(f"pick_place: {name} must be [low, high] with low ≤ high, got {list(pair)}")
    ranges = {name: np.clip(pair, -room.get(name, np.inf), room.get(name, np.inf)) for name, pair in pairs.items()}
    low, high = np.array(list(ranges.values()), dtype=np.float64).T
    return low, high

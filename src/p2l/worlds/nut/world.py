"""robosuite's square nut: grasp its handle, carry it over the peg, lower it, let go.

What fails here changes the world: a nut that meets the peg's edge turns in the fingers and stays so, and one that is
let go there lies on the peg's top, or leans at it. To go back and do the same again does not find the nut as it was.

Deviations from robosuite's task:
1. One nut and one peg; round nut and round peg are left out. The nut lies on one side of the table, its handle
   towards the robot (robosuite: any yaw), and the peg stands anywhere in a range of its own (robosuite: in one place).
2. The nut's torsional friction is MuJoCo's default, so that the pads' 5 cm count; with robosuite's 30 cm nothing ever
   turns in the fingers.
3. Where nut and peg are is uncertain, each in x and y; heights and the nut's orientation are observed without error.
4. The goal is robosuite's (the nut within 3 cm of the peg's axis, and low) with a height of 5 cm above the table, and
   the hand away from it.
5. Failure detectors, like the door's: the nut is not between the pads 0.25 s after the close command; it was and no
   longer is, with the fingers closed; the wrist force, averaged over a control step, is above `force_limit_n`.

Axis letters: N rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import mujoco
import numpy as np
from robosuite.models.arenas import PegsArena
from robosuite.models.objects import SquareNutObject

from p2l import poses
from p2l.contracts.estimator import Estimator, Mode
from p2l.contracts.option import Option
from p2l.contracts.rows import Command, Rows
from p2l.contracts.symbols import Symbols
from p2l.contracts.world import NO_FAILURE, View
from p2l.errors import ConfigError
from p2l.records import Array, BoolArray, IntArray
from p2l.sim.batch import Chunk
from p2l.sim.posture import reach
from p2l.sim.scene import FINGER_OPEN_M, FINGERS, WRIST_FORCE, Parts, Scene, build
from p2l.worlds.nut.geometry import DOWN, HANDLE_M, NUT_HALF_M, PEG_TOP_M, TABLE_M, UP, grasp_pose
from p2l.worlds.nut.skills import options
from p2l.worlds.nut.symbols import EMPTY_BELOW_M, OPEN_ABOVE_M, NutSymbols
from p2l.worlds.physics import VERSION, physics_of
from p2l.worlds.robot import Fields, RobotWorld

BASE_POS_WORLD = (-0.56, 0.0, 0.0)
PEG, NUT = "peg1", "SquareNut"
PEG_MIDDLE_M = 0.85
START_POS_WORLD = np.array([-0.1, 0.0, TABLE_M + 0.25])
FRICTION = (0.95, 0.005, 1e-4)
KINDS = ("missed_nut", "slip", "force")
IMPEDANCE = {
    "stiffness_linear": 3000.0,
    "damping_linear": 500.0,
    "stiffness_angular": 150.0,
    "damping_angular": 25.0,
    "joint_damping": 5.0,
}
CLOSING_STEPS = 5  # the fingers need four control steps from open to the handle
IN_GRIP_M = np.array([0.03, 0.015, 0.02])  # the hand is at most so far from the nominal grasp, in the nut's frame
ON_PEG_M, LOW_M = 0.03, 0.05
RELEASED_M = float(np.arctanh(0.4) / 10.0)  # robosuite: 1 − tanh(10 · distance) < 0.6 between grip site and object
RANGES = ("nut_x_m", "nut_y_m", "nut_yaw_rad", "peg_x_m", "peg_y_m")


class Nut(RobotWorld):
    """The square nut; every parameter is a plain value of its YAML.

    Args:
        arm: robosuite's name of the arm.
        estimator: how the estimates of nut and peg err.
        sigma_m: standard deviation of the nut's x and y, and of the peg's, m.
        sigma_least_m: below which none falls, m, see `contracts.estimator.Estimator`.
        nut_x_m, nut_y_m: ranges of the nut's place, world frame, m.
        nut_yaw_rad: range of the handle's direction from the one that points at the robot, rad.
        peg_x_m, peg_y_m: ranges of the peg's place, world frame, m.
        joint_noise_rad: standard deviation of each joint of the start posture, rad.
        force_limit_n: mean wrist force of a control step above which the detector speaks, N.
        timestep_s: physics time step.
        version: of the physics, see `worlds.physics.VERSIONS`.
        nthread: simulator threads.

    Raises:
        ConfigError: unknown arm, a reversed range, or places that the arm does not reach.
    """

    failure_kinds = KINDS
    memory_size = 2  # control steps since the close command; whether the nut was held
    mode_fields = ("nut_from_peg_m", "grip_in_nut_m", "nut_up", "gap_m")
    view = View(azimuth_deg=150.0, elevation_deg=-20.0, distance_m=0.8, lookat_m=(0.05, 0.0, 0.9))

    def __init__(
        self,
        *,
        arm: str = "Panda",
        estimator: Mode = "fixed",
        sigma_m: Sequence[float] = (0.008, 0.008),
        sigma_least_m: float = 0.0,
        nut_x_m: Sequence[float] = (-0.15, -0.05),
        nut_y_m: Sequence[float] = (0.0, 0.2),
        nut_yaw_rad: Sequence[float] = (-0.5, 0.5),
        peg_x_m: Sequence[float] = (0.10, 0.16),
        peg_y_m: Sequence[float] = (-0.1, 0.0),
        joint_noise_rad: float = 0.0,
        force_limit_n: float = 100.0,
        timestep_s: float = 0.005,
        version: int = VERSION,
        nthread: int = 2,
    ) -> None:
        params = {name: value for name, value in locals().items() if name not in ("self", "nthread", "__class__")}
        self.ranges = _ranges({name: params[name] for name in RANGES})
        if len(sigma_m) != 2:
            raise ConfigError(f"nut: sigma_m must be [nut, peg], got {list(sigma_m)}")
        if joint_noise_rad < 0.0 or force_limit_n <= 0.0:
            raise ConfigError(
                f"nut: joint_noise_rad ({joint_noise_rad}) must be at least 0, force_limit_n ({force_limit_n}) above 0"
            )
        self.force_limit_n, self.joint_noise_rad = force_limit_n, joint_noise_rad
        arena = PegsArena(table_full_size=(0.8, 0.8, 0.05), table_offset=(0.0, 0.0, TABLE_M))
        arena.set_origin([0, 0, 0])
        nut = SquareNutObject(name=NUT)
        parts = Parts(arena, [nut], BASE_POS_WORLD, furniture=(PEG,), pose_sensors={"nut": nut.root_body}, edit=_edit)
        scene = build(arm, parts, physics_of(version, IMPEDANCE | {"timestep_s": timestep_s}))
        errors = tuple(np.repeat(np.asarray(sigma_m, dtype=np.float64), 2).tolist())
        super().__init__("nut", params, [scene], Estimator(estimator, errors, sigma_least_m), nthread=nthread)
        self._nut_at = self._columns[nut.joints[0]] - 1
        self.finger_sign, self.start_rad = self._start(arm, scene)

    def sample(self, rng: np.random.Generator, n: int) -> Rows:
        """N nuts that lie on the table, the arm in its start posture, fingers open."""
        low, high = self.ranges
        place = rng.uniform(low, high, (n, len(RANGES)))
        qpos = np.zeros((n, self.engine.nq))
        arm = self.start_rad + self.joint_noise_rad * rng.standard_normal((n, len(self.start_rad)))
        qpos[:, [column - 1 for column in self._arm]] = arm
        for finger, position in zip(FINGERS, (FINGER_OPEN_M, -FINGER_OPEN_M), strict=True):
            qpos[:, self._columns[finger] - 1] = position
        at = self._nut_at
        qpos[:, at : at + 2] = place[:, :2]
        qpos[:, at + 2] = TABLE_M + NUT_HALF_M
        qpos[:, at + 3 : at + 7] = poses.quat(poses.about(UP, np.pi + place[:, 2]))
        peg = np.column_stack([place[:, 3:], np.full(n, PEG_MIDDLE_M), np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))])
        return self.rows(qpos, self.estimator.draw(rng, n), furniture={PEG: peg})

    def _start(self, arm: str, scene: Scene) -> tuple[float, Array]:
        """Which way round the fingers grasp, and the start posture [J], rad; judged at the corners of the ranges."""
        low, high = self.ranges
        nuts = [np.array([*xy, TABLE_M + NUT_HALF_M]) for xy in product(*zip(low[:2], high[:2], strict=True))]
        pegs = [np.array([*xy, PEG_TOP_M + 0.05]) for xy in product(*zip(low[3:], high[3:], strict=True))]
        starts: dict[float, Array] = {}
        for sign in (1.0, -1.0):
            down = poses.frame(np.array([[0.0, -sign, 0.0]]), DOWN[None])[0]
            grasps = [pos - [HANDLE_M, 0.0, 0.0] for pos in (*nuts, *pegs)]
            posture = reach(scene, START_POS_WORLD, down, starts=[scene.home])
            if posture is not None and all(reach(scene, pos, down, starts=[posture]) is not None for pos in grasps):
                starts[sign] = posture
        if not starts:
            raise ConfigError(
                f"nut: the arm {arm} has no posture with the hand facing down at every corner of {', '.join(RANGES)}; "
                "narrow them, or choose another arm"
            )
        best = min(starts, key=lambda sign: float(np.abs(starts[sign] - scene.home).sum()))
        return best, starts[best]

    def _truth(self, rows: Rows) -> Fields:
        return {
            **self._body(rows),
            **self._things(rows, np.zeros((len(rows), 4))),
            "held": self.in_grip(rows),
            "force_n": np.linalg.norm(self.read(rows, WRIST_FORCE), axis=1),
        }

    def _observation(self, rows: Rows, error: Array) -> Fields:
        return {
            **self._body(rows),
            **self._things(rows, error),
            "force_high": np.linalg.norm(self.read(rows, WRIST_FORCE), axis=1) > self.force_limit_n,
            "actions": rows.actions,
        }

    def _body(self, rows: Rows) -> Fields:
        return {
            "grip_pos_m": self.read(rows, "grip_pos"),
            "grip_quat": self.read(rows, "grip_quat"),
            "gap_m": self.gap_m(rows),
            "arm_rad": self.arm(rows),
        }

    def _things(self, rows: Rows, error: Array) -> dict[str, Array]:
        """Nut and peg, displaced by `error` [N, 4]: x and y of the nut, of the peg; the peg's place is its foot's."""
        level = np.zeros((len(rows), 1))
        nut = self.read(rows, "nut_pos") + np.concatenate([error[:, :2], level], axis=1)
        peg = self.furniture(rows, PEG)[:, :3] * [1.0, 1.0, 0.0] + [0.0, 0.0, TABLE_M]
        peg += np.concatenate([error[:, 2:], level], axis=1)
        quat = self.read(rows, "nut_quat")
        turn = poses.rotation(quat)
        grasp, _ = grasp_pose(nut, quat, 1.0)
        return {
            "nut_pos_m": nut,
            "nut_quat": quat,
            "nut_up": poses.rotate(turn, UP),
            "peg_pos_m": peg,
            "nut_from_peg_m": nut - peg,
            "grip_in_nut_m": poses.rotate(turn.inv(), self.read(rows, "grip_pos") - grasp),
        }

    def in_grip(self, rows: Rows) -> BoolArray:
        """[N] whether the handle is between the pads, and they are about as far apart as it is wide."""
        away = np.asarray(self._things(rows, np.zeros((len(rows), 4)))["grip_in_nut_m"])
        gap = self.gap_m(rows)
        return np.asarray((np.abs(away) < IN_GRIP_M).all(axis=1) & (gap > EMPTY_BELOW_M) & (gap < OPEN_ABOVE_M))

    def monitor(self, before: Rows, after: Rows, chunk: Chunk, command: Command) -> tuple[IntArray, Array]:
        """Missed nut, slip, force; see deviation 5."""
        steps, held = np.where(command.grip[:, None] > 0.5, before.memory, 0.0).T
        steps = np.where(command.grip > 0.5, steps + 1.0, 0.0)
        holds = self.in_grip(after) & (steps >= CLOSING_STEPS)
        force = np.linalg.norm(self.engine.sensor(chunk, WRIST_FORCE).mean(axis=1), axis=1)
        kind = np.full(len(after), NO_FAILURE, dtype=np.int64)
        kind[force > self.force_limit_n] = KINDS.index("force")
        kind[(held > 0.0) & ~holds] = KINDS.index("slip")
        kind[~holds & (steps == CLOSING_STEPS)] = KINDS.index("missed_nut")
        return kind, np.stack([steps, holds], axis=1).astype(np.float64)

    def goal(self, rows: Rows) -> BoolArray:
        """The nut around the peg and low, the hand away from it."""
        off = self._things(rows, np.zeros((len(rows), 4)))["nut_from_peg_m"]
        away = np.linalg.norm(self.read(rows, "nut_pos") - self.read(rows, "grip_pos"), axis=1) > RELEASED_M
        return np.asarray((np.abs(off[:, :2]) < ON_PEG_M).all(axis=1) & (off[:, 2] < LOW_M) & away)

    def nominal_options(self) -> tuple[Option, ...]:
        """Grasp, carry, lower, release."""
        return options(self.finger_sign)

    def symbols(self) -> Symbols:
        """The hand from the nut, the fingers, the nut from the peg."""
        return NutSymbols(self.finger_sign)


def _edit(spec: mujoco.MjSpec) -> None:
    spec.delete(spec.body("peg2"))
    for geom in spec.geoms:
        if geom.parent.name.startswith(NUT):
            geom.friction = list(FRICTION)


def _ranges(pairs: dict[str, Sequence[float]]) -> tuple[Array, Array]:
    for name, pair in pairs.items():
        if len(pair) != 2 or not np.isfinite(pair).all() or pair[0] > pair[1]:
            raise ConfigError(f"nut: {name} must be [low, high] with low ≤ high, got {list(pair)}")
    low, high = np.array(list(pairs.values()), dtype=np.float64).T
    return low, high

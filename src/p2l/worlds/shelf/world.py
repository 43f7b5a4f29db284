"""A thing from the table onto a shelf, observed at a wrong place; with and without clutter (thesis, 5.4.2, 5.4.3).

The hand closes on the box where it is observed. A box that is held too high above its middle hangs too low: it runs
into the edge of the shelf's floor, and may turn in the hand before the arm is stopped.

Where the thesis is silent, and deviations from it:
1. Detectors judge the mean force of a control step, as a filtered sensor does, against a limit tuned like the thesis's
   ("need to be tuned appropriately"). A slip counts from the lift, after a flag from there, and the other flags are
   raised when their condition becomes true: a hand that moves off is not stopped a second time for the first reason.
2. A slip is a turn or a shift in the hand since the lift. Nearly all come with a collision, so it is called
   "collision_slip" as in the thesis.
3. "Upright" is the distance of quaternions after the best turn about the vertical, which is what upright means.
4. Success in the cluttered shelf includes that no clutter was turned beyond its limit.
5. Clutter stands 0.07 to 0.10 m to either side of the middle (the author's ±0.1 m leaves the fingers all the room
   they need, and nothing would ever be turned) and nowhere nearer to the mouth than the middle.
6. `shelf_sigma_m` misplaces the shelf instead of the thing, which is how failures are induced in section 5.4.5.
7. Bottle and can have robosuite's shapes with the density of the box; robosuite's own weigh 15 g.

Axis letters: N rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import mujoco
import numpy as np

from p2l.contracts.estimator import Estimator, Mode
from p2l.contracts.observation import Privileged
from p2l.contracts.option import Option
from p2l.contracts.rows import Command, Rows
from p2l.contracts.world import NO_FAILURE, View
from p2l.records import Array, BoolArray, IntArray
from p2l.sim.batch import Chunk
from p2l.sim.scene import FINGER_OPEN_M, FINGERS, WRIST_FORCE, model_variant
from p2l.worlds.felt import FELT_SIZE, felt_force
from p2l.worlds.physics import EVEN, PLAIN, VERSION, physics_of
from p2l.worlds.robot import Fields, RobotWorld
from p2l.worlds.shelf import hold as hand
from p2l.worlds.shelf.scene import CLUTTER, DEPTH_M, INNER_WIDTH_M, TABLE_M, Clutter, compose, find
from p2l.worlds.shelf.skills import options
from p2l.worlds.shelf.starts import interval, positive, posture, starts_of, vector

IMPEDANCE = {"stiffness_linear": 2000.0, "stiffness_angular": 200.0, "damping_linear": 180.0, "damping_angular": 20.0}
KINDS = ("collision", "collision_slip", "dropped", "on_table")
COLLISION, SLIP, DROPPED, ON_TABLE, CLUTTER_ROTATED = range(5)
EMPTY_GAP_M = 0.01  # closed fingers that hold nothing
LYING_M = 0.03  # a thing whose origin is so low above the table lies there
LIFTED_M = 0.01
TARGET_M = 0.05
AWAY_M = 0.2
REST_M_S = 0.05
MOVED_M = 0.01  # half of a primitive


class Shelf(RobotWorld):
    """The shelf; every parameter is a plain value of its YAML.

    Args:
        arm: robosuite's name of the arm.
        object: what is placed, one of `worlds.shelf.scene.THINGS`.
        clutter: whether two boxes stand on the shelf.
        estimator: how the estimate of the thing's position errs.
        sigma_m: its standard deviation in y (into the shelf) and z, m.
        shelf_sigma_m: standard deviation of the shelf's estimated position in x, y and z, m.
        object_x_m, object_y_m, shelf_x_m, shelf_y_m, shelf_lift_m, shelf_height_m, clutter_x_m, clutter_y_m: ranges of
            start states, see `worlds.shelf.starts.Starts`.
        density_kg_m3: range of the thing's density.
        clutter_half_y_m, clutter_half_z_m: ranges of the clutter's half depth and half height, m.
        clutter_density_kg_m3: of the clutter.
        joint_noise_rad: standard deviation of each joint of the start posture.
        force_limit_n: mean wrist force of a control step above which a collision is flagged, N.
        slip_limit_rad, slip_limit_m: turn and shift in the hand above which a slip is flagged.
        clutter_limit_rad: turn of a clutter box above which it is flagged.
        models: how many densities (and sizes of clutter) the bank of models holds.
        version, and gain_scale to armature_scale: of the physics, see `worlds.physics.physics_of`.
        timestep_s, nthread: physics time step, and simulator threads.

    Raises:
        ConfigError: unknown arm or object, a range that is reversed or out of reach, a limit that is not positive.
    """

    view = View(azimuth_deg=150.0, elevation_deg=-20.0, distance_m=1.2, lookat_m=(0.0, 0.12, 0.95))
    mode_fields = ("object_pos_m - shelf_pos_m", "object_in_hand_m", "slip_rad", "gap_m")

    def __init__(
        self,
        *,
        arm: str = "Panda",
        object: str = "box",  # noqa: A002 (the YAML's word)
        clutter: bool = False,
        estimator: Mode = "fixed",
        sigma_m: Sequence[float] = (0.01, 0.02),
        shelf_sigma_m: Sequence[float] = (0.0, 0.0, 0.0),
        object_x_m: Sequence[float] = (-0.02, 0.02),
        object_y_m: Sequence[float] = (-0.02, 0.02),
        shelf_x_m: Sequence[float] = (0.0, 0.05),
        shelf_y_m: Sequence[float] = (0.30, 0.35),
        shelf_lift_m: Sequence[float] = (0.05, 0.10),
        shelf_height_m: Sequence[float] = (0.21, 0.30),
        clutter_x_m: Sequence[float] = (0.07, 0.10),
        clutter_y_m: Sequence[float] = (0.30, 0.35),
        density_kg_m3: Sequence[float] = (200.0, 300.0),
        clutter_half_y_m: Sequence[float] = (0.05, 0.06),
        clutter_half_z_m: Sequence[float] = (0.06, 0.07),
        clutter_density_kg_m3: float = 100.0,
        joint_noise_rad: float = 0.02,
        force_limit_n: float = 50.0,
        slip_limit_rad: float = 0.1,
        slip_limit_m: float = 0.02,
        clutter_limit_rad: float = 0.1,
        models: int = 16,
        gain_scale: float = 1.0,
        friction_scale: float = 1.0,
        axis_scale: Sequence[float] = EVEN,
        impratio: float | None = None,
        air_density: float = 0.0,
        joint_damping: float | None = None,
        armature_scale: float = 1.0,
        timestep_s: float = 1.0 / 240.0,
        version: int = VERSION,
        nthread: int = 2,
    ) -> None:
        params = {name: value for name, value in locals().items() if name not in ("self", "nthread", "__class__")}
        positive(params, "force_limit_n", "slip_limit_rad", "slip_limit_m", "clutter_limit_rad", "models")
        self.thing = find(object, version)
        self.starts = starts_of(self.thing, params)
        sigma = (*vector("sigma_m", sigma_m, 2), *vector("shelf_sigma_m", shelf_sigma_m, 3))
        sigma = sigma if any(sigma[2:]) else sigma[:2]  # without errors of the shelf, no numbers are drawn for them
        heavy = interval("density_kg_m3", density_kg_m3, (1.0, 2000.0))
        sizes = Clutter(
            interval("clutter_half_y_m", clutter_half_y_m, (0.01, DEPTH_M / 2 - 0.01)),
            interval("clutter_half_z_m", clutter_half_z_m, (0.01, self.starts.shelf_height_m[0] / 2)),
            clutter_density_kg_m3,
        )
        physics = physics_of(version, IMPEDANCE | {"timestep_s": timestep_s}, **{name: params[name] for name in PLAIN})
        self.bank = compose(arm, self.thing, physics, heavy, sizes if clutter else None, models)
        self.failure_kinds = (*KINDS, "clutter_rotated") if clutter else KINDS
        self._clutter: tuple[str, ...] = CLUTTER if clutter else ()
        self.memory_size = hand.MEMORY_SIZE + (FELT_SIZE if version > 1 else 0)
        self.force_limit_n, self.clutter_limit_rad = force_limit_n, clutter_limit_rad
        self.slip_limit_rad, self.slip_limit_m, self._noise_rad = slip_limit_rad, slip_limit_m, joint_noise_rad
        name = "cluttered_shelf" if clutter else "shelf"
        super().__init__(name, params, self.bank.scenes, Estimator(estimator, sigma), nthread=nthread)
        joint = self.scenes[0].model.joint(self.bank.object_joint)
        self._object_dofs = slice(int(joint.dofadr[0]), int(joint.dofadr[0]) + 3)
        self._start, self.hand_quat = posture(self.scenes[0], self.thing, self.starts)
        self.observe_hand_as(-self.hand_quat)  # which is how the Panda's joints put it

    def visual_model(self, model: int) -> mujoco.MjModel:
        """The model with visual geoms, clutter in this model's sizes."""
        return model_variant(self.scenes[model].visual_model, self.bank.edits[model])

    def sample(self, rng: np.random.Generator, n: int) -> Rows:
        """N starts: the thing upright on the table, the hand open before it."""
        layouts = self.starts.draw(rng, n)
        model = rng.integers(len(self.scenes), size=n)
        noise = self.estimator.draw(rng, n)
        qpos = np.zeros((n, self.engine.nq))
        arm = self._start + self._noise_rad * rng.standard_normal((n, len(self._start)))
        qpos[:, [column - 1 for column in self._arm]] = arm
        for joint, side in zip(FINGERS, (1.0, -1.0), strict=True):
            qpos[:, self._columns[joint] - 1] = side * FINGER_OPEN_M
        height = np.full((n, 1), TABLE_M + self.thing.bottom_m)
        self._stand(qpos, self.bank.object_joint, np.concatenate([layouts.object_m, height], axis=1))
        for box, joint in enumerate(self.bank.clutter_joints):
            self._stand(qpos, joint, layouts.clutter_pos_m(self.bank.clutter_half_m[model])[:, box])
        upright = np.tile(hand.UPRIGHT_QUAT, (n, 1))
        parts = {self.bank.lower: layouts.floor_m, self.bank.upper: layouts.roof_m}
        furniture = {name: np.concatenate([pos, upright], axis=1) for name, pos in parts.items()}
        return self.rows(qpos, noise, model=model, furniture=furniture)

    def _stand(self, qpos: Array, joint: str, pos: Array) -> None:
        place = self._columns[joint] - 1
        qpos[:, place : place + 3], qpos[:, place + 3 : place + 7] = pos, hand.UPRIGHT_QUAT

    def _body(self, rows: Rows) -> dict[str, Array]:
        return {
            "arm_rad": self.arm(rows),
            "grip_pos_m": self.read(rows, "grip_pos"),
            "grip_quat": self.read(rows, "grip_quat"),
            "gap_m": self.gap_m(rows),
            "shelf_pos_m": self.furniture(rows, self.bank.lower)[:, :3],
        }

    def _truth(self, rows: Rows) -> Fields:
        pose = self._in_hand(rows)
        turn, shift = hand.slip(pose, rows.memory)
        lower, upper = (self.furniture(rows, name)[:, 2] for name in (self.bank.lower, self.bank.upper))
        truth = self._body(rows) | {
            "object_pos_m": self.read(rows, "object_pos"),
            "object_quat": self.read(rows, "object_quat"),
            "object_in_hand_m": pose[0],
            "object_speed_m_s": self._speed(rows),
            "object_above_floor_m": self.read(rows, "object_pos")[:, 2] - self.thing.bottom_m - lower,
            "shelf_height_m": upper - lower,
            "held": rows.memory[:, hand.GRASP],
            "slip_rad": turn,
            "slip_m": shift,
            "force_n": rows.memory[:, hand.FORCE],
        }
        for name in self._clutter:
            truth[f"{name}_pos_m"] = self.read(rows, f"{name}_pos")
            truth[f"{name}_turn_rad"] = hand.turn_rad(self.read(rows, f"{name}_quat"))
        return truth

    def _observation(self, rows: Rows, error: Array) -> Fields:
        body = self._body(rows)
        pos = self.read(rows, "object_pos") + np.pad(error[:, :2], ((0, 0), (1, 0)))
        shelf = body["shelf_pos_m"] + (error[:, 2:] if error.shape[1] > 2 else 0.0)
        seen: Fields = body | {
            "object_pos_m": pos,
            "shelf_pos_m": shelf,
            "force_high": rows.memory[:, hand.FORCE] > self.force_limit_n,
            "actions": rows.actions,
        }
        return seen if self.version == 1 else {**seen, **self._relative(rows, body["grip_pos_m"], pos, shelf)}

    def _relative(self, rows: Rows, grip: Array, pos: Array, shelf: Array) -> dict[str, Array]:
        """Where hand, thing and shelf are to one another, alike for every thing, and what was felt."""
        planned = [0.0, self.thing.grip_before_m, -self.thing.grip_above_m]  # of the thing, from the hand that holds it
        return {
            "hand_to_shelf_m": shelf - grip,
            "thing_off_hold_m": pos - grip - planned,
            "bottom_above_floor_m": pos[:, 2] - self.thing.bottom_m - shelf[:, 2],
            "hand_to_target_m": self.target(rows)[:, :3] - grip,
            "felt_force": rows.memory[:, hand.MEMORY_SIZE :],
        }

    def _speed(self, rows: Rows) -> Array:
        return np.asarray(np.linalg.norm(self.engine.qvel(rows.states)[:, self._object_dofs], axis=1))

    def _in_hand(self, rows: Rows) -> hand.InHand:
        names = ("grip_pos", "grip_quat", "object_pos", "object_quat")
        return hand.in_hand(*(self.read(rows, name) for name in names))

    def _lies(self, rows: Rows) -> BoolArray:
        return np.asarray(self.read(rows, "object_pos")[:, 2] <= TABLE_M + LYING_M)

    def _clutter_turned(self, rows: Rows) -> BoolArray:
        turned = np.zeros(len(rows), dtype=np.bool_)
        for name in self._clutter:
            turned |= hand.turn_rad(self.read(rows, f"{name}_quat")) > self.clutter_limit_rad
        return turned

    def monitor(self, before: Rows, after: Rows, chunk: Chunk, command: Command) -> tuple[IntArray, Array]:
        """The detectors; see `KINDS` and the module's notes 1 and 2."""
        past = before.memory
        wrist = self.engine.sensor(chunk, WRIST_FORCE).mean(axis=1)
        force = np.linalg.norm(wrist, axis=1)
        high = force > self.force_limit_n
        close_command, pose = command.grip > 0.5, self._in_hand(after)
        up = self.read(after, "object_pos")[:, 2] > TABLE_M + self.thing.bottom_m + LIFTED_M
        full = self.gap_m(after) > EMPTY_GAP_M
        earlier = self._in_hand(before) if past[:, hand.FLAG].any() else pose  # which only a flag makes `hold` look at
        memory = hand.hold(past, close_command, up & full, earlier, pose)
        turn, shift = hand.slip(pose, memory)
        slip = (turn > self.slip_limit_rad) | (shift > self.slip_limit_m)
        empty = close_command & ~full
        empty &= (past[:, hand.CLOSE_STEPS] == 0) | (self.gap_m(before) > EMPTY_GAP_M)
        kind = np.full(len(after), NO_FAILURE, dtype=np.int64)
        kind[self._clutter_turned(after) & ~self._clutter_turned(before)] = CLUTTER_ROTATED
        kind[high] = COLLISION
        kind[slip] = SLIP
        kind[(memory[:, hand.LIFT] > 0) & self._lies(after) & ~self._lies(before)] = ON_TABLE
        kind[empty] = DROPPED
        memory[:, hand.FORCE], memory[:, hand.FLAG] = force, high | slip
        if self.version > 1:
            memory[:, hand.MEMORY_SIZE :] = felt_force(past[:, hand.MEMORY_SIZE :], wrist)
        return kind, memory

    def goal(self, rows: Rows) -> BoolArray:
        """At rest on the shelf, upright, near its middle, the hand open and away, no clutter turned."""
        pos, quat = self.read(rows, "object_pos"), self.read(rows, "object_quat")
        target = self.furniture(rows, self.bank.lower)[:, :3] + [0.0, -self.thing.place_before_m, self.thing.bottom_m]
        off = np.abs(pos - target)
        at_goal = (off[:, 1] < TARGET_M) & (off[:, 2] < TARGET_M)
        at_goal &= off[:, 0] < INNER_WIDTH_M / 2 - self.thing.half_width_m
        rests = (self._speed(rows) < REST_M_S) & (hand.upright_distance(quat) < hand.UPRIGHT)
        away = np.linalg.norm(self.read(rows, "grip_pos") - pos, axis=1) >= AWAY_M
        off_fingers = self.gap_m(rows) > 2.0 * self.thing.half_width_m + 0.01
        return np.asarray(at_goal & rests & away & off_fingers & ~self._clutter_turned(rows))

    def nominal_options(self) -> tuple[Option, ...]:
        """Pick, move, place."""
        return options(self.thing, self.hand_quat, self.version)

    def delivery_pos(self, truth: Privileged) -> Array:
        """On the board: half the box's height above the shelf's floor."""
        return truth["shelf_pos_m"] + [0.0, 0.0, 0.08]

    def strategies(self, before: Rows, after: Rows) -> dict[str, BoolArray]:
        """`up` and `inside`: the hand is higher, or deeper in the direction of the shelf, by more than `MOVED_M`."""
        shift = self.read(after, "grip_pos") - self.read(before, "grip_pos")
        return {"up": shift[:, 2] > MOVED_M, "inside": shift[:, 1] > MOVED_M}


ClutteredShelf = partial(Shelf, clutter=True)

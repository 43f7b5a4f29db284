"""A block pushed to a goal line by a free-flying hand: the small world of docs/new-world.md, in one file.

1. There is no arm: the hand is a free body whose site follows the impedance target, so no start is out of reach.
"""

from __future__ import annotations

import mujoco
import numpy as np

from p2l.contracts.estimator import Estimator, Mode
from p2l.contracts.observation import Observation, Privileged
from p2l.contracts.option import Option
from p2l.contracts.world import NO_FAILURE, Command, Rows
from p2l.errors import ConfigError
from p2l.records import Array, BoolArray, IntArray
from p2l.sim.batch import Chunk
from p2l.sim.scene import Physics, Scene, finish
from p2l.skills.follow import Follow, Waypoints
from p2l.worlds.robot import Fields, RobotWorld

GOAL_X_M = 0.12
HALF_BLOCK_M = 0.03
DOWN = np.array([1.0, 0.0, 0.0, 0.0])


def spec() -> mujoco.MjSpec:
    """A table top, a block and a ball-shaped hand."""
    scene = mujoco.MjSpec()
    scene.worldbody.add_light(pos=[0.0, 0.0, 1.0])
    scene.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.5, 0.5, 0.1])
    block = scene.worldbody.add_body(name="block", pos=[0.0, 0.0, HALF_BLOCK_M])
    block.add_freejoint(name="block")
    block.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[HALF_BLOCK_M] * 3, mass=0.2)
    hand = scene.worldbody.add_body(name="hand", pos=[-0.1, 0.0, HALF_BLOCK_M], gravcomp=1.0)
    hand.add_freejoint(name="hand")
    hand.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.015, 0.0, 0.0], mass=0.2)
    hand.add_site(name="hand")
    return scene


class Push(RobotWorld):
    """Blocks at random places; the hand pushes in a straight line and may miss when the estimate is off."""

    failure_kinds = ("missed",)
    memory_size = 1  # the hand's distance from the block's middle line when it came alongside, m

    def __init__(
        self,
        *,
        estimator: Mode = "fixed",
        sigma_m: float = 0.01,
        block_y_m: tuple[float, float] = (-0.05, 0.05),
        nthread: int = 2,
    ) -> None:
        if not block_y_m[0] <= block_y_m[1]:
            raise ConfigError(f"push: block_y_m must be [low, high], got {list(block_y_m)}")
        physics = Physics(
            timestep_s=0.005, stiffness_linear=200.0, damping_linear=20.0, stiffness_angular=0.05, damping_angular=0.005
        )
        model, drawn = finish(spec, "hand", {"block": "block"}, (), physics)
        scene = Scene(model, drawn, (), np.zeros(0), physics)
        params = {"sigma_m": sigma_m, "block_y_m": list(block_y_m)}
        super().__init__("push", params, [scene], Estimator(estimator, (sigma_m,)), nthread=nthread)
        self.block_y_m = block_y_m

    def sample(self, rng: np.random.Generator, n: int) -> Rows:
        """Blocks on a line across the way."""
        qpos = np.tile(self.engine.models[0].qpos0, (n, 1))
        qpos[:, 1] = rng.uniform(*self.block_y_m, n)
        return self.rows(qpos, self.estimator.draw(rng, n))

    def _truth(self, rows: Rows) -> Fields:
        return {"grip_pos_m": self.read(rows, "grip_pos"), "block_pos_m": self.read(rows, "block_pos")}

    def _seen(self, rows: Rows, error: Array) -> Fields:
        return {
            "grip_pos_m": self.read(rows, "grip_pos"),
            "block_y_m": self.read(rows, "block_pos")[:, 1:2] + error,
            "actions": rows.actions,
        }

    def monitor(self, before: Rows, after: Rows, chunk: Chunk, command: Command) -> tuple[IntArray, Array]:
        """Missed: the hand is ahead of the block's middle and beside it."""
        ahead = self.read(after, "grip_pos") - self.read(after, "block_pos")
        missed = (ahead[:, 0] > 0.0) & (np.abs(ahead[:, 1]) > HALF_BLOCK_M)
        return np.where(missed, 0, NO_FAILURE), np.where(missed[:, None], ahead[:, 1:2], before.memory)

    def goal(self, rows: Rows) -> BoolArray:
        """The block's middle is beyond the line."""
        return self.read(rows, "block_pos")[:, 0] >= GOAL_X_M


def options(world: Push) -> tuple[Option, ...]:
    """Come alongside, then push."""

    def align(seen: Observation) -> Waypoints:
        pos = np.stack([np.full(len(seen), -0.08), seen["block_y_m"][:, 0], np.full(len(seen), HALF_BLOCK_M)], axis=1)
        return Waypoints(pos[:, None], np.tile(DOWN, (len(seen), 1, 1)), np.zeros((len(seen), 1)))

    def push(seen: Observation) -> Waypoints:
        pos = seen["target_pos_m"] * [0.0, 1.0, 1.0] + [GOAL_X_M, 0.0, 0.0]
        return Waypoints(pos[:, None], np.tile(DOWN, (len(seen), 1, 1)), np.zeros((len(seen), 1)))

    def behind(truth: Privileged) -> BoolArray:
        return truth["grip_pos_m"][:, 0] < truth["block_pos_m"][:, 0] - HALF_BLOCK_M

    def aligned(truth: Privileged) -> BoolArray:
        beside = np.abs(truth["grip_pos_m"][:, 1] - truth["block_pos_m"][:, 1])
        return behind(truth) & (beside < 0.5 * HALF_BLOCK_M)

    return (Follow("align", align, (10,), (3,), behind), Follow("push", push, (30,), (5,), aligned))

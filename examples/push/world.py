"""A block pushed to a goal line by a free-flying hand: the smallest world that p2l can learn about."""

from __future__ import annotations

import numpy as np

from examples.push.scene import HALF_BLOCK_M, spec
from examples.push.skills import GOAL_X_M, options
from p2l.contracts.estimator import Estimator, Mode
from p2l.contracts.option import Option
from p2l.contracts.rows import Command, Rows
from p2l.contracts.world import NO_FAILURE
from p2l.records import Array, BoolArray, IntArray
from p2l.sim.batch import Chunk
from p2l.sim.scene import Physics, Scene, finish
from p2l.worlds.robot import Fields, RobotWorld

PHYSICS = {"stiffness_linear": 200.0, "damping_linear": 20.0, "stiffness_angular": 0.05, "damping_angular": 0.005}


class Push(RobotWorld):
    """Blocks at random places `block_y_m`; the hand misses where the estimate, of error `sigma_m`, is off."""

    failure_kinds = ("missed",)
    memory_size = 1  # the hand's distance from the block's middle line when it came alongside, m

    def __init__(
        self, *, estimator: Mode = "fixed", sigma_m: float = 0.01, block_y_m: tuple[float, float] = (-0.05, 0.05),
        nthread: int = 2,
    ) -> None:  # fmt: skip
        physics = Physics(timestep_s=0.005, **PHYSICS)
        scene = Scene(*finish(spec, "hand", {"block": "block"}, (), physics), (), np.zeros(0), physics)
        params = {"sigma_m": sigma_m, "block_y_m": list(block_y_m)}
        super().__init__("push", params, [scene], Estimator(estimator, (sigma_m,)), nthread=nthread)
        self.block_y_m = block_y_m

    def sample(self, rng: np.random.Generator, n: int) -> Rows:
        qpos = np.tile(self.engine.models[0].qpos0, (n, 1))
        qpos[:, 1] = rng.uniform(*self.block_y_m, n)
        return self.rows(qpos, self.estimator.draw(rng, n))

    def _truth(self, rows: Rows) -> Fields:
        return {"grip_pos_m": self.read(rows, "grip_pos"), "block_pos_m": self.read(rows, "block_pos")}

    def _observation(self, rows: Rows, error: Array) -> Fields:
        block_y = self.read(rows, "block_pos")[:, 1:2] + error
        return {"grip_pos_m": self.read(rows, "grip_pos"), "block_y_m": block_y, "actions": rows.actions}

    def monitor(self, before: Rows, after: Rows, chunk: Chunk, command: Command) -> tuple[IntArray, Array]:
        ahead = self.read(after, "grip_pos") - self.read(after, "block_pos")
        missed = (ahead[:, 0] > 0.0) & (np.abs(ahead[:, 1]) > HALF_BLOCK_M)  # ahead of the block's middle, beside it
        return np.where(missed, 0, NO_FAILURE), np.where(missed[:, None], ahead[:, 1:2], before.memory)

    def goal(self, rows: Rows) -> BoolArray:
        return self.read(rows, "block_pos")[:, 0] >= GOAL_X_M

    def nominal_options(self) -> tuple[Option, ...]:
        return options()

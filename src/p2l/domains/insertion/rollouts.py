"""Skills in the abstract simulation: where the tip of the part ends, or its whole path.

Axis letters: K skills, M tasks, N rows, R noise draws, T physics steps, P = 24 parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from p2l.contracts.domain import Progress, Tasks
from p2l.domains.insertion.physics import POSITION_SENSOR, InsertionPhysics, build_model, start_states
from p2l.domains.insertion.waypoints import WAYPOINT_SIZE, WAYPOINTS, WaypointTiming, execute
from p2l.records import Array, IntArray
from p2l.sim.batch import Engine

ROWS_PER_BATCH = 2048
TIMING = WaypointTiming(control_steps=8, settle_steps=1, stiffness_angular=4.0, stiffness_bounds=(50.0, 1500.0))


@dataclass(frozen=True)
class Rollouts:
    """The simulation of skills on tasks.

    Attributes:
        physics: the abstract simulation.
        nthread: simulator threads.
    """

    physics: InsertionPhysics
    nthread: int

    def model(self, tasks: Tasks, index: int) -> mujoco.MjModel:
        """The scene of one task."""
        return build_model(tasks.payload["walls"][index, : tasks.payload["wall_count"][index]], self.physics)

    def tips(
        self, skills: Array, tasks: Tasks, task_index: IntArray, errors: Array, progress: Progress | None = None
    ) -> Array:
        """[N, 3] where the tip ends, slot's frame, m.

        Args:
            skills: [N, P].
            tasks: M tasks.
            task_index: [N] the task of each row.
            errors: [N, 2] error of each row's slot estimate, m.
            progress: called after every batch with the rows so far and N.
        """
        numbers, model_index = np.unique(task_index, return_inverse=True)
        models = [self.model(tasks, int(number)) for number in numbers]
        tips = []
        with Engine(models, control_period_s=self.physics.control_period_s, nthread=self.nthread) as engine:
            for first in range(0, len(skills), ROWS_PER_BATCH):
                rows = slice(first, first + ROWS_PER_BATCH)
                states = start_states(engine, errors[rows], self.physics)
                waypoints = skills[rows].reshape(-1, WAYPOINTS, WAYPOINT_SIZE)
                chunk, _ = execute(
                    engine, states, waypoints, model_index[rows], TIMING, position_sensor=POSITION_SENSOR
                )
                tips.append(engine.sensor(chunk, "tip_pos")[:, -1])
                if progress is not None:
                    progress(min(rows.stop, len(skills)), len(skills))
        return np.concatenate(tips)

    def tip_paths(self, skill: Array, task: Tasks, errors: Array) -> Array:
        """[R, T, 3] paths of the tip of one skill [P] on one task under slot errors [R, 2]; slot's frame, m."""
        draws = len(errors)
        with Engine([self.model(task, 0)], control_period_s=self.physics.control_period_s, nthread=1) as engine:
            _, trace = execute(
                engine,
                start_states(engine, errors, self.physics),
                np.tile(skill.reshape(1, WAYPOINTS, WAYPOINT_SIZE), (draws, 1, 1)),
                np.zeros(draws, dtype=np.int64),
                TIMING,
                position_sensor=POSITION_SENSOR,
                keep_trace=True,
            )
        assert trace is not None
        return trace.sensor("tip_pos")

"""The demonstration that a search starts from: touch the nearest wall, come back, search along it, push.

Axis letters: M tasks, P = 24 parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p2l.contracts.domain import Tasks
from p2l.domains.insertion.features import DIRECTIONS, DISTANCE_NAMES, PART_HALF_WIDTH
from p2l.domains.insertion.waypoints import WAYPOINT_SIZE, WAYPOINTS
from p2l.records import Array


@dataclass(frozen=True)
class Demonstration:
    """What the person shows (m and N/m): how far the part is pushed past the wall, pressed and swept."""

    overtravel: float = 0.015
    press: float = 0.008
    sweep: float = 0.009
    push: float = 0.03
    stiffness: float = 500.0

    def waypoints(self, tasks: Tasks, hover: float, rng: np.random.Generator) -> Array:
        """[M, P] the waypoints that a person shows on each task: touch, press, come back, search, push.

        Args:
            tasks: M tasks.
            hover: height of the tip above the board at the start, m.
            rng: which of several equally near walls.
        """
        distances = tasks.features[:, : len(DISTANCE_NAMES)] / 100.0
        nearest = distances + rng.uniform(0.0, 1e-4, distances.shape)
        side = nearest.argmin(1)
        wall = distances[np.arange(len(tasks)), side]
        towards = np.zeros((len(tasks), 3))
        towards[:, :2] = DIRECTIONS[side]
        along = np.stack([-towards[:, 1], towards[:, 0], np.zeros(len(tasks))], axis=1)
        down = np.array([0.0, 0.0, -1.0])
        press = self.press * down
        waypoints = np.zeros((len(tasks), WAYPOINTS, WAYPOINT_SIZE))
        waypoints[:, 0, :3] = towards * (wall - PART_HALF_WIDTH + self.overtravel)[:, None]
        waypoints[:, 1, :3] = press + hover * down
        waypoints[:, 2, :3] = -towards * (wall - PART_HALF_WIDTH)[:, None] + press
        waypoints[:, 3, :3] = -self.sweep * along + press
        waypoints[:, 4, :3] = 2.0 * self.sweep * along + press
        waypoints[:, 5, :3] = self.push * down
        waypoints[:, :, 3] = np.log10(self.stiffness)
        return waypoints.reshape(len(tasks), -1)

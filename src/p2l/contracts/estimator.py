"""The simulated state estimator: what the robot believes is the truth plus an error that depends on its actions.

Each row carries its own unit normals for the whole episode (`Rows.noise`), so an estimate is a function of the row
and of the number of actions so far, whatever batch the row is in.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from p2l.errors import ConfigError
from p2l.records import Array, IntArray

Mode = Literal["exact", "fixed", "halving", "after_first"]
MODES: tuple[str, ...] = get_args(Mode)
DRAWS = 12  # beyond that many actions a halved error is below 10 µm, and the last draw stays


@dataclass(frozen=True)
class Estimator:
    """How the error develops.

    Attributes:
        mode: `exact` none; `fixed` one error for the whole episode; `halving` a new error after every action, of half
            the standard deviation (thesis, section 4.4.1, "Evaluation in Simulation"); `after_first` exact once the
            first skill has ended (section 4.4.1, "Evaluation on a Real Robot").
        sigma_m: [E] standard deviation of each estimated coordinate at the start, m.
        least_m: where the error halves, no standard deviation becomes smaller than this, m (those that are smaller at
            the start stay as they are): a sensor that does not see the truth however often it looks.

    Raises:
        ConfigError: unknown mode, or a negative standard deviation.
    """

    mode: Mode
    sigma_m: tuple[float, ...]
    least_m: float = 0.0

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise ConfigError(f"unknown estimator '{self.mode}'; known: {', '.join(MODES)}")
        if not all(np.isfinite(sigma) and sigma >= 0.0 for sigma in self.sigma_m):
            raise ConfigError(f"estimator: sigma_m must be numbers of at least 0, got {self.sigma_m}")
        if not (np.isfinite(self.least_m) and self.least_m >= 0.0):
            raise ConfigError(f"estimator: the least standard deviation must be at least 0, got {self.least_m}")

    def draw(self, rng: np.random.Generator, n: int) -> Array:
        """[N, DRAWS, E] unit normals of n episodes."""
        return rng.standard_normal((n, DRAWS, len(self.sigma_m)))

    def error(self, noise: Array, actions: IntArray) -> Array:
        """[N, E] estimate − truth, m, after `actions` [N] actions."""
        rows = np.arange(len(noise))
        sigma = np.asarray(self.sigma_m)
        if self.mode == "exact":
            return np.zeros((len(noise), len(sigma)))
        if self.mode == "fixed":
            return noise[:, 0] * sigma
        if self.mode == "after_first":
            return noise[:, 0] * sigma * (actions == 0)[:, None]
        draw = np.minimum(actions, DRAWS - 1)
        halved = sigma * 0.5 ** actions[:, None].astype(np.float64)
        return noise[rows, draw] * np.maximum(halved, np.minimum(self.least_m, sigma))

"""What a planner is given besides the problem, and what it comes back with."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import numpy as np

from p2l.errors import ConfigError
from p2l.records import IntArray
from p2l.team.problem import Certificate

_LONGEST_S = 1e6  # eleven days, as good as no limit; the operating system's timers end somewhere


@dataclass(frozen=True)
class StoppingRule:
    """When a planner may stop: the wall-clock `deadline` (of `time.perf_counter`) or a relative `gap`."""

    deadline: float
    gap: float

    @property
    def seconds_left(self) -> float:
        """Seconds until the deadline, never quite zero."""
        return max(1e-3, self.deadline - time.perf_counter())


@dataclass(frozen=True)
class PlannerResult:
    """What a planner comes back with.

    Attributes:
        decision: [n].
        complete: None for a heuristic; else whether it ended by itself, and not by the deadline.
        certificate: what proves its bound, if it has such; "optimal" is what the check says of it.
        sequence: [n] order of work; None for the natural one.
    """

    decision: IntArray
    complete: bool | None = None
    certificate: Certificate | None = None
    sequence: IntArray | None = None


Planner = Callable[..., PlannerResult]  # of a Problem and a StoppingRule, and options of its own


def check_stopping(time_limit_s: object, gap: object) -> tuple[float, float]:
    """A time limit in wall seconds and a relative gap, as numbers.

    Raises:
        ConfigError: something else, a time limit of zero or less, a gap outside [0, 1).
    """
    numbers = {"time_limit_s": time_limit_s, "gap": gap}
    for name, value in numbers.items():
        if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
            raise ConfigError(f"{name}: {value!r} given; expected a number")
        if isinstance(value, int) and abs(value) > _LONGEST_S:
            numbers[name] = math.inf if value > 0 else -math.inf
    limit_s, relative = (float(cast(float, value)) for value in numbers.values())
    if not limit_s > 0.0:
        raise ConfigError(f"time_limit_s: {time_limit_s} given; it must be above 0")
    if not 0.0 <= relative < 1.0:
        raise ConfigError(f"gap: {gap} given; it is relative and must lie in [0, 1)")
    return min(limit_s, _LONGEST_S), relative

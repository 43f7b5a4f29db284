"""What an execution leaves behind: states and sensors of N rows over C control steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p2l.records import Array
from p2l.sim.batch import Chunk


@dataclass(frozen=True)
class Trace:
    """N rows over C control steps of T physics steps each.

    Attributes:
        states: [N, C + 1, S]; column 0 is the start, column c the end of control step c.
        sensors: [N, C · T, D] after every physics step.
        columns: where each named sensor lies in the last axis of `sensors`.
        timestep_s: physics time step.
    """

    states: Array
    sensors: Array
    columns: dict[str, slice]
    timestep_s: float

    def sensor(self, name: str) -> Array:
        """[N, C · T, d] values of one named sensor."""
        return self.sensors[..., self.columns[name]]

    @classmethod
    def join(cls, start: Array, chunks: list[Chunk], columns: dict[str, slice], timestep_s: float) -> Trace:
        """Put the chunks of consecutive control steps together."""
        states = np.stack([start, *(chunk.states for chunk in chunks)], axis=1)
        sensors = np.concatenate([chunk.sensors for chunk in chunks], axis=1)
        return cls(states, sensors, columns, timestep_s)

"""Skills as waypoints in the end effector's frame, executed for many rows at once (thesis, section 3.5).

A waypoint is a displacement and a stiffness. The first displacement starts from the pose in which the skill is
handed over (above the estimated slot), each later one from where the end effector stands when the waypoint begins,
so a touch that stops the end effector at a wall removes the uncertainty of everything that follows.

Axis letters: N rows, W waypoints.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p2l.errors import ShapeError
from p2l.records import Array, IntArray
from p2l.sim.batch import Chunk, Engine
from p2l.sim.trace import Trace

WAYPOINT_SIZE = 4
WAYPOINTS = 6  # of an insertion skill
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True)
class WaypointTiming:
    """How a waypoint is played.

    Attributes:
        control_steps: control steps of a waypoint.
        settle_steps: how many of them the target rests at the waypoint.
        stiffness_angular: N·m/rad about each axis.
        stiffness_bounds: N/m, the range in which a skill's stiffness is kept.
    """

    control_steps: int
    settle_steps: int
    stiffness_angular: float
    stiffness_bounds: tuple[float, float]


def execute(
    engine: Engine,
    states: Array,
    skills: Array,
    model_index: IntArray,
    timing: WaypointTiming,
    *,
    position_sensor: str,
    keep_trace: bool = False,
) -> tuple[Chunk, Trace | None]:
    """Run one waypoint skill per row, all rows together.

    Args:
        engine: the batched simulator.
        states: [N, S] rows whose impedance target coincides with the end effector.
        skills: [N, W, 4]; displacement x, y, z in m (world axes) and log10 of the stiffness in N/m.
        model_index: [N].
        timing: how each waypoint is played.
        position_sensor: sensor with the end effector's position, world frame, m.
        keep_trace: also return states and sensors of every control step.

    Returns:
        The last control step, and the trace if it was asked for.
    """
    if skills.ndim != 3 or skills.shape[0] != len(states) or skills.shape[2] != WAYPOINT_SIZE:
        raise ShapeError(f"skills: has shape {skills.shape}; expected [{len(states)}, W, {WAYPOINT_SIZE}]")
    start, chunks = states, []
    quat = np.tile(UPRIGHT, (len(states), 1))
    moving = max(1, timing.control_steps - timing.settle_steps)
    position = engine.target_pos(states)
    low, high = np.log10(timing.stiffness_bounds)
    chunk = Chunk(states, np.zeros((len(states), 0, 0)), np.zeros(len(states), dtype=np.bool_))
    for waypoint in range(skills.shape[1]):
        goal = position + skills[:, waypoint, :3]
        linear = 10.0 ** np.clip(skills[:, waypoint, 3], low, high)
        control = engine.stiffness(len(states), linear, timing.stiffness_angular)
        for step in range(timing.control_steps):
            share = min(1.0, (step + 1) / moving)
            chunk = engine.step(chunk.states, position + share * (goal - position), quat, control, model_index)
            if keep_trace:
                chunks.append(chunk)
        position = engine.sensor(chunk, position_sensor)[:, -1]
    if not keep_trace:
        return chunk, None
    return chunk, Trace.join(start, chunks, engine.sensor_columns, engine.timestep_s)

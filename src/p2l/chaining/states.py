"""The names of a recovery MDP's actions, and its state out of an observation.

Axis letters: N rows, O observation columns, A actions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from p2l.chaining.mdp import Limits
from p2l.contracts.observation import Observation
from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import World
from p2l.errors import ShapeError
from p2l.records import IntArray


def action_names(primitives: Sequence[Option], nominal: Sequence[Option]) -> tuple[str, ...]:
    """A names: the primitives, then the nominal options as `from <option>`, at which the chain continues."""
    return tuple([option.name for option in primitives] + [f"from {option.name}" for option in nominal])


def sound(world: World, rows: Rows) -> Observation:
    """The observation of the rows.

    Raises:
        ShapeError: NaN or infinity.
    """
    observation = world.observe(rows)
    if not np.isfinite(observation.values).all():
        bad = [name for name in observation.columns if not np.isfinite(observation[name]).all()]
        raise ShapeError(f"{world.name}: the observation holds NaN or infinity in {', '.join(bad)}")
    return observation


def state_fields(observation: Observation, limits: Limits) -> Observation:
    """The fields of an observation that make up a state: those of `limits`, or all.

    Raises:
        ShapeError: no such field.
    """
    return Observation.of({name: observation[name] for name in limits.fields}) if limits.fields else observation


def state_columns(observation: Observation, limits: Limits) -> IntArray:
    """[O] columns of an observation that `state_fields` takes, in its order; the same for all of a world."""
    numbers = np.arange(observation.values.shape[1], dtype=np.float64)[None]
    return state_fields(Observation(observation.columns, numbers), limits).values[0].astype(np.int64)


def first_state(world: World, rows: Rows, limits: Limits) -> Observation:
    """The state [N, O] at the start of an episode, whose history repeats the first observation."""
    return Observation.stack([state_fields(sound(world, rows), limits)] * limits.history)

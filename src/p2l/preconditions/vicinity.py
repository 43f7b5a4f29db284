"""States in the vicinity of a skill's good starts: full simulator states, all of them reached by moving there.

The thesis samples τ in the vicinity of D_i⁺ and sets the state to it (Algorithm 2). A point of D_i⁺ in nine features
is no simulator state: posture, fingers and contact forces are missing, and a hand put around a lever by inverse
kinematics would not hold it as a hand does that closed there. So states are reached:

1. *As reached*: where the skill before ended, its estimate of the object off by up to `noise` times the estimator's
   error. For the first skill, a start state.
2. *Moved*: any moment of such an execution, failed or not, from which the hand goes straight to a state drawn from
   D_i⁺ plus a displacement, the fingers as there all the way, or opened first. This gives the negatives near the
   boundary, and it is how a recovery arrives. The displacement is normal, of up to `spread` times what counts as far
   for the world's columns (`Symbols.far`): good starts may hardly vary in a direction in which much is allowed. A hand
   that something kept farther than `arrival_m` from where it was sent is in no vicinity, and the sample is left out:
   else D⁺ would stretch to wherever hands get stuck, and failures there would be taken for good starts.

Axis letters: N rows, K skills.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.symbols import Symbols
from p2l.contracts.world import World
from p2l.errors import ConfigError
from p2l.preconditions.mixture import Mixture
from p2l.records import BoolArray
from p2l.skills import chain
from p2l.skills.execute import execute, without_noise
from p2l.skills.relative import WAYPOINTS, Timing, straight


@dataclass(frozen=True)
class Vicinity:
    """How far around good starts samples reach.

    Attributes:
        noise: largest multiple of the estimator's error in the executions that samples come from.
        spread: largest displacement of good starts, in multiples of `Symbols.far` (one standard deviation).
        moved: share of samples that are moved, in [0, 1].
        arrival_m: how far from where it was sent a hand may end.
    """

    noise: float = 2.0
    spread: float = 0.5
    moved: float = 0.5
    arrival_m: float = 0.03

    def __post_init__(self) -> None:
        positive = all(0.0 < value < np.inf for value in (self.noise, self.spread, self.arrival_m))
        if not (positive and 0.0 <= self.moved <= 1.0):
            raise ConfigError(
                f"vicinity: noise {self.noise}, spread {self.spread}, arrival_m {self.arrival_m}, moved {self.moved} "
                "given; expected three positive numbers and a share in [0, 1]"
            )


@dataclass(frozen=True)
class MomentPool:
    """Moments of nominal executions under wrong estimates.

    Attributes:
        starts: K sets of rows, where each skill started.
        moments: all starts and ends.
    """

    starts: tuple[Rows, ...]
    moments: Rows


def moment_pool(
    world: World, options: Sequence[Option], starts: Rows, noise: float, rng: np.random.Generator
) -> MomentPool:
    """Moments of the open-loop chain from `starts` [N], each with an error of up to `noise` times its own."""
    factor = noise * rng.random((len(starts), 1, 1))
    noisy = replace(starts, noise=starts.noise * factor)
    run = chain.run(world, options, noisy, stop_on_failure=False)
    ends = run.ends.take(~run.diverged[run.ends.episode])
    sets = [noisy, *(ends.rows.take(ends.option == index) for index in range(len(options)))]
    return MomentPool(tuple(without_noise(rows) for rows in sets[:-1]), without_noise(Rows.join(sets)))


def sample(
    world: World,
    symbols: Symbols,
    pool: MomentPool,
    skill: int,
    good: Mixture,
    count: int,
    vicinity: Vicinity,
    timing: Timing,
    rng: np.random.Generator,
) -> tuple[Rows, BoolArray]:
    """At most `count` rows around the starts of `skill`, and which of them a motion of the hand led to.

    One that diverges, or does not arrive, is left out.

    Args:
        world: where.
        symbols: describes it.
        pool: where samples come from.
        skill: index of the skill.
        good: D⁺ of its starts.
        count: samples.
        vicinity: how far.
        timing: of the motions.
        rng: decides everything.
    """
    motions = round(vicinity.moved * count)
    starts = pool.starts[skill].take(rng.integers(len(pool.starts[skill]), size=count - motions))
    if not motions:
        return starts, np.zeros(count, dtype=np.bool_)
    before = pool.moments.take(rng.integers(len(pool.moments), size=motions))
    goals = good.sample(rng, motions)
    width = vicinity.spread * rng.random((motions, 1)) * symbols.far
    goals = goals + width * rng.standard_normal(goals.shape)
    observation = world.observe(before)
    pos, quat = symbols.hand(observation, goals)
    parameters = straight(observation, pos, quat, symbols.fingers_closed(goals)).reshape(motions, WAYPOINTS, 7)
    parameters[rng.random(motions) < 0.5, : WAYPOINTS - 1, 6] = -1.0
    arrivals = execute(world, before, parameters.reshape(motions, -1), timing)
    away_m = np.linalg.norm(world.privileged(arrivals.last)["grip_pos_m"] - pos, axis=1)
    sound = arrivals.last.take((away_m <= vicinity.arrival_m) & ~arrivals.diverged)
    return Rows.join([starts, sound]), np.repeat([False, True], [len(starts), len(sound)])

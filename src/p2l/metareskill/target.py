"""Where recoveries lead: a precondition or the goal, as a reward, as a test and as a place to go to.

R(s) = 0.1 log f_D⁺(s) + 10 ρ(s) (thesis, section 4.4); for the goal f is the density of the states in which nominal
executions end, and ρ is 1 where the task is done.

Axis letters: N rows, M targets.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p2l.contracts.observation import Observation, Privileged
from p2l.contracts.rows import Rows
from p2l.contracts.symbols import Symbols
from p2l.contracts.world import World
from p2l.metareskill.regression import ParameterisedSkill
from p2l.preconditions.record import Preconditions
from p2l.records import Array, BoolArray
from p2l.skills.relative import straight

DENSITY, PROBABILITY = 0.1, 10.0


@dataclass(frozen=True)
class RecoveryTask:
    """A world with its preconditions, as recoveries see it.

    Attributes:
        world: where.
        symbols: describes it.
        preconditions: ρ_1 … ρ_K, and the goal.
    """

    world: World
    symbols: Symbols
    preconditions: Preconditions

    @property
    def targets(self) -> tuple[str, ...]:
        """M names."""
        return self.preconditions.targets

    def state(self, rows: Rows) -> Array:
        """[N, D] on the truth."""
        return self.symbols.state(self.world.privileged(rows))

    def holds(self, rows: Rows) -> BoolArray:
        """[N, M] which targets hold, on the truth."""
        return self.preconditions.holds(self.state(rows), self.world.goal(rows))

    def judge(self, rows: Rows, target: int) -> tuple[Array, BoolArray]:
        """[N] reward R of being there, and [N] whether the target holds."""
        states, done = self.state(rows), self.world.goal(rows)
        reached = self.preconditions.probability(states, done)[:, target]
        density = self.preconditions.density(target).log_density(states)
        return DENSITY * density + PROBABILITY * reached, np.asarray(reached >= self.preconditions.threshold)

    def towards(self, known: Privileged | Observation, seen: Observation, states: Array) -> Array:
        """[N, P] parameters of the straight motion of each row to the hand's pose in `states` [N, D].

        Args:
            known: what is known of the objects.
            seen: where the hand is.
            states: N states, one for each row.
        """
        return straight(seen, *self.symbols.hand(known, states), self.symbols.closed(states))

    def straight(self, seen: Observation, target: int) -> Array:
        """[N, P] the straight motion of each row to the mean of the target's D⁺, as far as is seen."""
        mean = self.preconditions.density(target).means[0]
        return self.towards(seen, seen, np.tile(mean, (len(seen), 1)))

    def recovery(self, skill: ParameterisedSkill, target: int, seen: Observation) -> Array:
        """[N, P] what a learnt skill does from each row."""
        predicted = skill.predict(self.symbols.state(seen)[:, list(self.symbols.context)])
        return predicted + self.straight(seen, target) if skill.residual else predicted

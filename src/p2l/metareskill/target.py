"""Where recoveries lead: a precondition or the goal, as a reward, as a test and as a place to go to.

R(s) = 0.1 log f_D⁺(s) + 10 ρ(s) (thesis, section 4.4); for the goal f is the density of the states in which nominal
executions end, and ρ is 1 where the task is done.

How to get there is guessed before anything is learnt (`GUESSES`). The thesis knows the straight motion; a hand that is
to hold something has to take hold of it first:
- `straight`: to the hand's pose in the goal state, the fingers as there.
- `take`: from behind, along the hand's own axis and with open fingers, to the pose in which it holds the things where
  they are now; there the fingers close.
- `carry`: to the pose in which it holds the things where they are now, closes, and moves with them to the goal state.

Axis letters: N rows, M targets, P parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p2l import poses
from p2l.contracts.observation import Observation, Privileged
from p2l.contracts.rows import Rows
from p2l.contracts.symbols import Symbols
from p2l.contracts.world import World
from p2l.metareskill.regression import ParameterisedSkill
from p2l.preconditions.record import Preconditions
from p2l.records import Array, BoolArray
from p2l.skills import chain
from p2l.skills.execute import without_noise
from p2l.skills.relative import parameters_of, straight

DENSITY, PROBABILITY = 0.1, 10.0
GUESSES = ("straight", "take", "carry")
BEHIND_M = 0.08  # from where the hand comes to take hold of something


@dataclass(frozen=True)
class RecoveryTask:
    """A world with its preconditions, as recoveries need it.

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

    def judge(self, rows: Rows, target: int, *, verify: bool = False) -> tuple[Array, BoolArray]:
        """[N] reward R of being there, and [N] whether the target holds.

        Args:
            rows: where motions led.
            target: where to.
            verify: a learnt precondition that holds is tried: it counts as 0 where the nominal skills from there on do
                not reach the goal.
        """
        states, done = self.state(rows), self.world.goal(rows)
        probability = self.preconditions.probability(states, done)[:, target]
        holds = np.asarray(probability >= self.preconditions.threshold)
        if verify and holds.any():
            holds[holds] = self.leads_to_goal(rows.take(holds), target)
            probability = np.where(holds, probability, 0.0)
        density = self.preconditions.density(target).log_density(states)
        return DENSITY * density + PROBABILITY * probability, holds

    def leads_to_goal(self, rows: Rows, target: int) -> BoolArray:
        """[N] whether the nominal skills from the target's on reach the goal, the state being known."""
        options = self.world.nominal_options()[target:]
        if not options:
            return self.world.goal(rows)
        known = without_noise(rows)
        return chain.run(self.world, options, known, stop_on_failure=False, slots=len(known)).success

    def towards(self, source: Privileged | Observation, observation: Observation, goals: Array) -> Array:
        """[N, P] parameters of the straight motion of each row to the hand's pose in its goal state.

        Args:
            source: where the objects are, by the truth or by the robot's estimate.
            observation: where the hand is.
            goals: [N, D] a goal state for each row.
        """
        return straight(observation, *self.symbols.hand(source, goals), self.symbols.fingers_closed(goals))

    def guess(self, name: str, source: Privileged | Observation, observation: Observation, goals: Array) -> Array:
        """[N, P] parameters of the motion of that name; `straight` where the fingers are open in the goal state.

        Args:
            name: one of `GUESSES`.
            source: where the objects are, by the truth or by the robot's estimate.
            observation: where the hand is.
            goals: [N, D] a goal state for each row.
        """
        motion = self.towards(source, observation, goals)
        if name == "straight":
            return motion
        now = np.array(goals)
        things = list(getattr(self.symbols, "things", ()))
        now[:, things] = self.symbols.state(source)[:, things]
        at, there = self.symbols.hand(source, now), self.symbols.hand(source, goals)
        behind = at[0] - BEHIND_M * poses.rotate(poses.rotation(at[1]), [0.0, 0.0, 1.0])
        way = [(behind, at[1]), at, at] if name == "take" else [at, at, there]
        fingers = [-1.0, -1.0, 1.0] if name == "take" else [-1.0, 1.0, 1.0]
        holding = self.symbols.fingers_closed(goals)
        return np.where(holding[:, None], parameters_of(observation, way, fingers), motion)

    def guessed(self, name: str, observation: Observation, target: int) -> Array:
        """[N, P] the guess to the mean of the target's D⁺, by the robot's estimate."""
        return self.guess(name, observation, observation, self._means(len(observation), target))

    def straight(self, observation: Observation, target: int) -> Array:
        """[N, P] the straight motion of each row to the mean of the target's D⁺, by the robot's estimate."""
        return self.towards(observation, observation, self._means(len(observation), target))

    def recovery(self, skill: ParameterisedSkill, target: int, observation: Observation) -> Array:
        """[N, P] the motion of a recovery skill from each row."""
        parameters = skill.predict(self.symbols.state(observation)[:, list(self.symbols.context)])
        return parameters + self.guessed(skill.guess, observation, target) if skill.guess else parameters

    def _means(self, count: int, target: int) -> Array:
        return np.tile(self.preconditions.density(target).means[0], (count, 1))

"""A policy with its handover rule: when control goes back to the nominal controllers, and to which of them.

Axis letters: K rows, O observation columns.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from p2l.artifacts import load_arrays, save_arrays
from p2l.chaining.learner import Learner
from p2l.chaining.mdp import Limits
from p2l.chaining.policy import Policy, check_policy, load_policy, save_policy
from p2l.chaining.preconditions import ControllerPreconditions
from p2l.chaining.states import action_names, first_state
from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import World
from p2l.errors import ArtifactError
from p2l.records import Array, IntArray
from p2l.skills.primitives import grips_beside

Act = Callable[[Array], IntArray]
PRECONDITIONS = "preconditions.npz"


@dataclass(frozen=True)
class Agent:
    """The robot's behaviour after a failure.

    Attributes:
        limits: bounds of an episode.
        primitives: the agent's own actions; actions beyond them are nominal options.
        act: [K] actions of the network from [K, O] states.
        preconditions: hand over to the best nominal controller where one holds, or at the bounds.
        whole_task: acts from the start of the task.
    """

    limits: Limits
    primitives: tuple[Option, ...]
    act: Act
    preconditions: ControllerPreconditions | None = None
    whole_task: bool = False

    def choose(self, observation: Array, decision: IntArray) -> IntArray:
        """[K] actions for the `decision` [K] of each episode, counted from 0."""
        action = self.act(observation)
        if self.preconditions is not None:
            longest = max(option.max_steps for option in self.primitives)
            most = min(self.limits.decisions, -(-self.limits.primitive_steps // longest))
            handover = self.preconditions.holds(observation) | (decision >= most)
            action = np.where(handover, len(self.primitives) + self.preconditions.best(observation), action)
        return action


def agent_of(learner: Learner, act: Act) -> Agent:
    """The agent of a policy that is still being trained."""
    return Agent(learner.limits, learner.primitives, act, learner.preconditions, learner.whole_task)


def save_agent(folder: Path, policy: Policy, learner: Learner) -> None:
    """Write the policy, and the preconditions where the learner has some."""
    save_policy(folder, policy)
    if learner.preconditions is not None:
        arrays = learner.preconditions.arrays()
        save_arrays(folder / PRECONDITIONS, arrays, schema="recovery_preconditions", version=1)


def load_agent(
    folder: Path, world: World, nominal: Sequence[Option], rows: Rows, *, transfer: bool = False
) -> tuple[Agent, Policy]:
    """The agent written by `save_agent`, checked against this world.

    Args:
        folder: of the run.
        world: where it is to act.
        nominal: the chain there.
        rows: any of the world; their observation has the columns of the world.
        transfer: accept a policy of a world with other parameters.

    Raises:
        ArtifactError: missing, damaged, or of another world, other columns or other actions.
    """
    policy = load_policy(folder)
    card = policy.card
    moves = world.primitives()
    own = {option.name: option for option in (*moves, *grips_beside(moves))}
    if unknown := [name for name in card.actions if name not in own and not name.startswith("from ")]:
        raise ArtifactError(f"{folder}: a policy over actions that there are no more: {', '.join(unknown)}")
    primitives = tuple(own[name] for name in card.actions if name in own)
    options = len(card.actions) > len(primitives)
    missing = [name for name in card.limits.fields if name not in world.observe(rows.take([0])).columns]
    plain = replace(card.limits, fields=()) if missing else card.limits
    check_policy(
        policy,
        folder,
        world=world.name,
        digest=world.digest,
        columns=first_state(world, rows.take([0]), plain).names,
        actions=action_names(primitives, nominal if options else ()),
        transfer=transfer,
    )
    preconditions = None
    if card.preconditions:
        arrays = load_arrays(folder / PRECONDITIONS, schema="recovery_preconditions", version=1)
        preconditions = ControllerPreconditions.from_arrays(arrays)
    return Agent(card.limits, primitives, policy.act, preconditions, card.whole_task), policy

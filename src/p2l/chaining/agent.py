"""A learnt policy with what its learner wants done around it: who hands over to the nominal controllers, and when.

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
from p2l.chaining.pool import action_names, first_state
from p2l.chaining.preconditions import ControllerPreconditions
from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import World
from p2l.errors import ArtifactError
from p2l.records import Array, IntArray
from p2l.skills.primitives import GRIPS, PRIMITIVES, STEPS, Primitive

Act = Callable[[Array], IntArray]
PRECONDITIONS = "preconditions.npz"
_KNOWN = {primitive.name: primitive for primitive in (*PRIMITIVES, *GRIPS)}


@dataclass(frozen=True)
class Agent:
    """Who acts after a failure.

    Attributes:
        limits: bounds of an episode.
        primitives: the agent's own actions; actions beyond them are nominal options.
        act: [K] actions of the network from [K, O] states.
        preconditions: hand over to the best nominal controller where one holds, or at the bounds.
        whole_task: acts from the start of the task.
    """

    limits: Limits
    primitives: tuple[Primitive, ...]
    act: Act
    preconditions: ControllerPreconditions | None = None
    whole_task: bool = False

    def choose(self, observation: Array, decision: IntArray) -> IntArray:
        """[K] actions for the `decision` [K] of each episode, counted from 0."""
        action = self.act(observation)
        if self.preconditions is not None:
            most = min(self.limits.decisions, -(-self.limits.primitive_steps // STEPS))
            handed = self.preconditions.met(observation) | (decision >= most)
            action = np.where(handed, len(self.primitives) + self.preconditions.best(observation), action)
        return action


def agent_of(learner: Learner, act: Act) -> Agent:
    """The policy that is being learnt."""
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
    """The agent that `save_agent` left, for this world.

    Args:
        folder: of the run.
        world: where it is to act.
        nominal: the chain there.
        rows: any of the world, to see what is observed in it.
        transfer: the world may have other parameters than the one the policy was learnt in.

    Raises:
        ArtifactError: missing, damaged, or learnt for another world, other columns or other actions.
    """
    policy = load_policy(folder)
    card = policy.card
    if unknown := [name for name in card.actions if name not in _KNOWN and not name.startswith("from ")]:
        raise ArtifactError(f"{folder}: a policy over actions that there are no more: {', '.join(unknown)}")
    primitives = tuple(_KNOWN[name] for name in card.actions if name in _KNOWN)
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
    known = None
    if card.preconditions:
        arrays = load_arrays(folder / PRECONDITIONS, schema="recovery_preconditions", version=1)
        known = ControllerPreconditions.from_arrays(arrays)
    return Agent(card.limits, primitives, policy.act, known, card.whole_task), policy

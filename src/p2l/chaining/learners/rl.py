"""Flat reinforcement learning: the whole task from its start, primitives only, a dense hand-designed reward.

The reward of a decision is the growth of a potential, and 1 for the task: come to the object, hold it, bring it to its
place.

1. "Just the primitive actions" cannot move the fingers, so that nothing could ever be held; this learner may also open
   and close them.
2. Its episodes have to last for a whole task: they have bounds of their own. Scripts of single primitives need a median
   of 63 decisions, up to 79; who learns by trial gets about twice as many.
3. The growth is Φ' − Φ. Ng, Harada and Russell (1999) leave the best policy unchanged with γ Φ' − Φ, which charges
   1 − γ of the potential for every decision near the goal; without it a way to and fro gains as much, 1 % of it.
4. Nothing ends an episode early, so that λ is SB3's 0.95 here (conf/learner/rl.yaml), and the observations of a whole
   task are far from those at its start, so that their standardisation goes on while it learns.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from p2l.chaining.learner import ChainTask, Learner, whole
from p2l.chaining.mdp import Limits, Outcomes
from p2l.contracts.observation import Privileged
from p2l.contracts.rows import Rows
from p2l.contracts.world import Delivering, World
from p2l.errors import ConfigError
from p2l.records import Array, BoolArray
from p2l.seeding import generator
from p2l.skills.primitives import grips_beside

Place = Callable[[Privileged], Array]
REACH, HOLD, CARRY = 0.3, 0.2, 0.5
NEAR_M, SHARPNESS_PER_M = 0.06, 5.0


def learner(task: ChainTask, limits: Limits, *, decisions: int = 150, starts: int = 500) -> Learner:
    """The whole task.

    Args:
        task: of the policy.
        limits: observations that a state is made of.
        decisions: of an episode.
        starts: start states, drawn once.

    Raises:
        ConfigError: the world does not define where its object belongs, or a parameter makes no sense.
    """
    for name, value in (("decisions", decisions), ("starts", starts)):
        if not whole(value, at_least=1):
            raise ConfigError(f"rl: {name} must be an integer of at least 1, got {value!r}")
    if not isinstance(task.world, Delivering):
        raise ConfigError(
            f"rl: no dense reward for world '{task.world.name}'; say where its object belongs by a method "
            "`delivery_pos(truth)` of its class (p2l.contracts.world.Delivering)"
        )
    rows = task.world.sample(generator(task.seed, "rl", task.world.name, "starts"), starts)
    bounds = replace(limits, decisions=decisions, primitive_steps=10 * decisions)
    dense = _growth(task.world, task.world.delivery_pos)
    return Learner(
        bounds,
        rows,
        (*task.world.primitives(), *grips_beside(task.world.primitives())),
        options=False,
        judge=dense,
        whole_task=True,
        running_normalisation=True,
    )


def potential(world: World, rows: Rows, place: Place) -> Array:
    """[K] in [0, 1], 1 where the object is held at its place."""
    truth = world.privileged(rows)
    thing = truth["object_pos_m"]
    reach = np.linalg.norm(truth["grip_pos_m"] - thing, axis=1)
    holding = (reach < NEAR_M) & (rows.grip > 0.5) & (truth["gap_m"][:, 0] > 0.01)
    away = np.linalg.norm(place(truth) - thing, axis=1)
    return REACH * _closeness(reach) + holding * (HOLD + CARRY * _closeness(away))


def _closeness(distance_m: Array) -> Array:
    return np.asarray(1.0 - np.tanh(SHARPNESS_PER_M * distance_m))


def _growth(world: World, place: Place) -> Callable[[Outcomes], tuple[Array, BoolArray]]:
    def judge(outcomes: Outcomes) -> tuple[Array, BoolArray]:
        growth = potential(world, outcomes.after, place) - potential(world, outcomes.before, place)
        return growth + outcomes.done, outcomes.done

    return judge

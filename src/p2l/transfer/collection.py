"""Algorithm 1: learn skills on some tasks in abstract simulation and try every skill on every task.

Deviation from the thesis: 1. A pair's label is a success rate over several noise draws rather than one binary
outcome, since the planner uses the prediction as a probability.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from p2l.contracts.domain import Domain, Progress, Tasks, View
from p2l.records import Array, TransferData
from p2l.seeding import generator

VIEWS = 5


@runtime_checkable
class WallDomain(Protocol):
    """A domain whose tasks have walls that can be left out."""

    def without_walls(self, tasks: Tasks) -> Tasks:
        """The same tasks with nothing to lean on."""

    def evaluate_own(self, skills: Array, tasks: Tasks, draws: int, rng: np.random.Generator) -> Array:
        """[K] success rate of skill k on task k."""


@dataclass(frozen=True)
class Collection:
    """The outcome of one run of Algorithm 1.

    Attributes:
        data: every skill on every task.
        own_rate: [K] success of each skill on the task it was learnt on.
        own_rate_without_walls: [K] the same with every wall removed, for domains that have walls.
        views: what the first few skills do on their own tasks.
    """

    data: TransferData
    own_rate: Array
    own_rate_without_walls: Array | None
    views: list[View]


def collect(
    domain: Domain, *, n_tasks: int, n_taught: int, draws: int, seed: int, progress: Progress | None = None
) -> Collection:
    """Sample `n_tasks` tasks, learn a skill on the first `n_taught`, evaluate all pairs `draws` times.

    The tasks come in random order, so the taught ones are a random choice; learning, evaluating and ablating draw
    from generators of their own.
    """
    tasks = domain.sample_tasks(generator(seed, "collect", domain.name, "tasks"), n_tasks)
    train_task = generator(seed, "collect", domain.name, "taught").permutation(n_tasks)[:n_taught]
    skills = domain.learn(tasks, train_task, generator(seed, "collect", domain.name, "learn"), progress)
    learnt_on = tasks.take(train_task)
    rng = generator(seed, "collect", domain.name, "evaluate")
    outcome = domain.evaluate(skills, learnt_on, tasks, draws, rng, progress)
    data = TransferData(
        names=tasks.names,
        features=tasks.features,
        feature_names=domain.feature_names,
        group=tasks.group,
        train_task=train_task,
        successes=outcome.sum(-1),
        draws=draws,
        skills=skills,
    )
    own = data.rate[np.arange(n_taught), train_task]
    bare = None
    if isinstance(domain, WallDomain):
        rng = generator(seed, "collect", domain.name, "ablate")
        bare = domain.evaluate_own(skills, domain.without_walls(learnt_on), draws, rng)
    rng = generator(seed, "collect", domain.name, "view")
    views = [domain.view(skills[k], learnt_on.take(k), rng) for k in range(min(VIEWS, n_taught))]
    return Collection(data=data, own_rate=own, own_rate_without_walls=bare, views=views)

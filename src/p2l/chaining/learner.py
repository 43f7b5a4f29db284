"""A learner: the recovery MDP that PPO trains in (actions, reward, start states), and how its policy is executed.

A learner is one file with a function `learner(task, limits, **settings) -> Learner`, and one line in
`learners/table.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from p2l.chaining.mdp import Judge, Limits, task_success
from p2l.chaining.pool import Pool
from p2l.chaining.preconditions import ControllerPreconditions
from p2l.chaining.revisit import Revisits
from p2l.chaining.search_settings import SearchSettings
from p2l.chaining.shortcut import Shortcut
from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import World
from p2l.errors import ConfigError


def no_failures(world: str) -> ConfigError:
    """The error of a world without recorded failures."""
    return ConfigError(
        f"no failures of world '{world}' to recover from; find some with `python -m stages.discover` and the "
        "same world=…, with more executions or more noise"
    )


def whole(value: object, *, at_least: int) -> bool:
    """Whether a parameter is an integer that is large enough."""
    return isinstance(value, int) and not isinstance(value, bool) and value >= at_least


def share(value: object) -> bool:
    """Whether a parameter is a number strictly between 0 and 1."""
    return isinstance(value, float) and 0.0 < value < 1.0


@dataclass(frozen=True)
class ChainTask:
    """The task of a recovery policy.

    Attributes:
        world: of the task.
        nominal: the chain π_1 … π_k.
        failures: recorded failures to learn from.
        seed: of the run; a learner derives its own generators from it.
        vary: makes the world with some parameters changed, for learners that practise elsewhere, too.
    """

    world: World
    nominal: Sequence[Option]
    failures: Rows
    seed: int
    vary: Callable[[Mapping[str, Any]], World] | None = None

    def __post_init__(self) -> None:
        if not len(self.failures):
            raise no_failures(self.world.name)


@dataclass(frozen=True)
class Learner:
    """A recovery MDP, and how a policy of it is executed.

    Attributes:
        limits: bounds of an episode.
        starts: start states of its episodes.
        primitives: the agent's own actions; the world's without any (`make_learner` puts them in).
        options: whether the nominal options are actions, too.
        judge: reward and termination of a decision.
        shortcut: predicts options that need not be simulated.
        preconditions: hand over to the best nominal controller where one of them holds, or at the episode's bounds.
        whole_task: the policy acts from the task's start, without the nominal controllers.
        running_normalisation: observations are standardised over all that is met, not over the start states alone.
        search: macros are searched, and no policy gradient is taken.
        others: worlds, by name, whose failures a search practises on besides the task's.
        told: numbers for the reader of the policy's card and of the run's summary: what was done before training.

    Raises:
        ConfigError: the longest macro leaves no decision for its option.
    """

    limits: Limits
    starts: Rows
    primitives: tuple[Option, ...] = ()
    options: bool = True
    judge: Judge = task_success
    shortcut: Shortcut | None = None
    preconditions: ControllerPreconditions | None = None
    whole_task: bool = False
    running_normalisation: bool = False
    search: SearchSettings | None = None
    others: Mapping[str, World] = field(default_factory=dict)
    told: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        decisions = self.limits.decisions
        if self.search is not None and self.search.longest >= decisions:
            raise ConfigError(
                f"search: longest ({self.search.longest}) leaves no decision of limits.decisions ({decisions}) for a "
                f"macro's option; give at most {decisions - 1}"
            )

    def pool(self, task: ChainTask, rng: np.random.Generator, slots: int, revisit: float = 0.0) -> Pool:
        """The recovery MDP; episodes start at one of `starts`, drawn by `rng`, or continue an earlier success.

        Args:
            task: of the policy.
            rng: draws the start states.
            slots: episodes at once.
            revisit: see `revisit.Revisits`; not used for whole tasks.
        """
        rows, nominal = self.starts, task.nominal if self.options else ()
        again = None
        if revisit and not self.whole_task:
            again = Revisits(revisit, slots, self.limits.decisions, rng.spawn(1)[0])

        def some(n: int) -> Rows:
            return rows.take(rng.integers(len(rows), size=n))

        return Pool(task.world, nominal, self.primitives, some, slots, self.limits, self.judge, again)

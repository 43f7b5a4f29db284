"""The learner that plans: macros are searched on recorded failures, a network learns which one to use where."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from p2l.chaining.learner import ChainTask, Learner
from p2l.chaining.mdp import Limits
from p2l.chaining.search_settings import SearchSettings
from p2l.contracts.observation import Observation
from p2l.contracts.world import World
from p2l.errors import ConfigError, P2LError


def learner(
    task: ChainTask,
    limits: Limits,
    *,
    trials: int = 200,
    portfolio: int = 60,
    longest: int = 8,
    updates: int = 2000,
    mixture: Mapping[str, Mapping[str, Any]] | None = None,
    executions: int = 300,
) -> Learner:
    """The MDP of RecoveryChaining, searched; for the settings see `SearchSettings`.

    Args:
        task: of the policy.
        limits: bounds of an episode.
        trials: of a round.
        portfolio: macros that the model chooses among.
        longest: most primitives of a macro.
        updates: of the network, for each evaluation.
        mixture: by name, the parameters in which further worlds differ from the task's; failures of the nominal skills
            there are practised on and evaluated, too, so that the policy works with other things and other gains.
        executions: of the nominal skills in each of these.

    Raises:
        ConfigError: a setting is refused, no decision is left for a macro's option (`Learner`), or a world of the
            mixture is refused or observes something else.
    """
    plan = SearchSettings(trials, portfolio, longest, updates, executions=executions)
    others = {name: _other(task, limits, name, differs) for name, differs in _named(mixture).items()}
    return Learner(limits, task.failures, search=plan, others=others)


def _named(mixture: Mapping[str, Mapping[str, Any]] | None) -> Mapping[str, Mapping[str, Any]]:
    if mixture is None:
        return {}
    if not mixture and isinstance(mixture, Mapping):
        raise ConfigError(
            "search: the mixture names no world; name some in conf/chaining/<world>.yaml, under "
            "learners.search_mixed.params.mixture, or say learner=search"
        )
    if not isinstance(mixture, Mapping) or not all(isinstance(each, Mapping) and each for each in mixture.values()):
        raise ConfigError(
            "search: mixture must name worlds by the parameters that differ, such as "
            f"{{bottle: {{object: bottle}}}}, got {mixture!r}"
        )
    return mixture


def _other(task: ChainTask, limits: Limits, name: str, differs: Mapping[str, Any]) -> World:
    """A world of the mixture."""
    if task.vary is None:
        raise ConfigError("search: a mixture needs a world that was made from parameters")
    try:
        world = task.vary(differs)
    except P2LError as error:
        raise ConfigError(f"search: mixture.{name}: {error}") from error
    own = _sizes(task.world.observe(task.failures.take([0])))
    there = _sizes(world.observe(world.sample(np.random.default_rng(0), 1)))
    lost = [field for field in limits.fields or own if own[field] != there.get(field)]
    if lost or (not limits.fields and list(own.items()) != list(there.items())):
        what = ", ".join(f"{field} ({there[field]} columns)" if field in there else field for field in lost)
        raise ConfigError(f"search: mixture.{name}: that world does not observe the task's {what or 'fields alone'}")
    return world


def _sizes(seen: Observation) -> dict[str, int]:
    """Columns of each field; where they lie is another matter, and differs with the joints of an arm."""
    return {field: place.stop - place.start for field, place in seen.columns.items()}

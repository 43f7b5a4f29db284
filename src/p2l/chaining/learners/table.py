"""The learners that are compared, by name.

A new one of ours is a file, a function and a line here, and a YAML in `conf/learner/`; one of another package needs
the YAML alone (`p2l.registry`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from p2l.registry import Registry

if TYPE_CHECKING:  # who checks a name in a configuration needs no learner
    from p2l.chaining.learner import ChainTask, Learner
    from p2l.chaining.mdp import Limits


def _rc() -> Callable[..., Learner]:
    from p2l.chaining.learners.rc import learner

    return learner


def _lazy_rc() -> Callable[..., Learner]:
    from p2l.chaining.learners.lazy_rc import learner

    return learner


def _pp() -> Callable[..., Learner]:
    from p2l.chaining.learners.pp import learner

    return learner


def _rl() -> Callable[..., Learner]:
    from p2l.chaining.learners.rl import learner

    return learner


def _search() -> Callable[..., Learner]:
    from p2l.chaining.learners.search import learner

    return learner


LEARNERS: Registry[Callable[..., Learner]] = Registry(
    "learner", {"rc": _rc, "lazy_rc": _lazy_rc, "pp": _pp, "rl": _rl, "search": _search}
)


def make_learner(name: str, task: ChainTask, limits: Limits, params: Mapping[str, Any] | None = None) -> Learner:
    """The learner `name`, or of a target (`package.module:function`), for a task.

    Args:
        name: of the learner.
        task: of the policy.
        limits: bounds of an episode.
        params: its own settings.

    Raises:
        ConfigError: unknown, or a parameter that it does not take or refuses.
    """
    from p2l.chaining.learner import Learner

    factory = LEARNERS.factory_for(name, params, own=2)
    with LEARNERS.given(name, factory, params):
        made = factory(task, limits, **dict(params or {}))
    learner = LEARNERS.expect(name, made, Learner)
    return learner if learner.primitives else replace(learner, primitives=task.world.primitives())

"""The one list of learners; a new one adds one line here, one file, and one YAML in `conf/learner/`."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from p2l.errors import ConfigError

if TYPE_CHECKING:  # who checks a name in a configuration needs no learner
    from p2l.chaining.learner import Learner, Task
    from p2l.chaining.mdp import Limits

_MODULES: dict[str, str] = {}


def register_learner(name: str, module: str) -> None:
    """Make the function `learner` of `module` available as `name`; it is imported on first use.

    Raises:
        ConfigError: the name is taken.
    """
    if _MODULES.setdefault(name, module) != module:
        raise ConfigError(f"learner '{name}' is already registered as '{_MODULES[name]}'; choose another name")


def known_learners() -> tuple[str, ...]:
    """Names of all learners, sorted."""
    return tuple(sorted(_MODULES))


def make_learner(name: str, task: Task, limits: Limits, params: Mapping[str, Any] | None = None) -> Learner:
    """The learner `name` for a task.

    Raises:
        ConfigError: unknown, or a parameter that it does not take.
    """
    if name not in _MODULES:
        raise ConfigError(f"unknown learner '{name}'; known: {', '.join(known_learners())}")
    make = importlib.import_module(_MODULES[name]).learner
    given = dict(params or {})
    allowed = tuple(inspect.signature(make).parameters)[2:]
    if unknown := sorted(set(given) - set(allowed)):
        raise ConfigError(f"learner '{name}': unknown parameters {unknown}; allowed: {', '.join(allowed) or 'none'}")
    made: Learner = make(task, limits, **given)
    return made


register_learner("rc", "p2l.chaining.learners.rc")
register_learner("lazy_rc", "p2l.chaining.learners.lazy_rc")
register_learner("pp", "p2l.chaining.learners.pp")
register_learner("rl", "p2l.chaining.learners.rl")

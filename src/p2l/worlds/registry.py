"""The one list of domains. A new world adds one line here; the contract test then covers it."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Mapping
from typing import Any

from p2l.errors import ConfigError
from p2l.worlds.domain import Domain

_FACTORIES: dict[str, str] = {}


def register(name: str, factory: str) -> None:
    """Make `factory` (`package.module:callable`) available as `name`; its module is imported on first use.

    Raises:
        ConfigError: the name is taken by another factory, or `factory` has no colon.
    """
    if ":" not in factory:
        raise ConfigError(f"domain '{name}': factory '{factory}' has no colon; write 'package.module:callable'")
    if _FACTORIES.setdefault(name, factory) != factory:
        raise ConfigError(f"domain '{name}' is already registered as '{_FACTORIES[name]}'; choose another name")


def known_domains() -> tuple[str, ...]:
    """Names of all registered domains, sorted."""
    return tuple(sorted(_FACTORIES))


def get_domain(name: str, params: Mapping[str, Any] | None = None) -> Domain:
    """Build the domain `name` with keyword parameters `params`.

    Raises:
        ConfigError: unknown domain, or a parameter that its factory does not take.
    """
    if name not in _FACTORIES:
        raise ConfigError(f"unknown domain '{name}'; known domains: {', '.join(known_domains()) or 'none'}")
    module, _, attribute = _FACTORIES[name].partition(":")
    factory: Callable[..., Domain] = getattr(importlib.import_module(module), attribute)
    given = dict(params or {})
    allowed = tuple(inspect.signature(factory).parameters)
    if unknown := sorted(set(given) - set(allowed)):
        raise ConfigError(f"domain '{name}': unknown parameters {unknown}; allowed: {', '.join(allowed) or 'none'}")
    return factory(**given)


register("board", "p2l.skills.insertion:board")
register("insertion", "p2l.skills.insertion:insertion")
register("lego", "p2l.worlds.lego:Lego")

"""The one list of domains (chapter 3) and of manipulation worlds (chapters 4 and 5).

A new one adds one line here and the contract tests cover it. Factories are named, not imported: a stage loads only
the world that it works on.
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from p2l.contracts.domain import Domain
from p2l.errors import ConfigError

if TYPE_CHECKING:  # a stage of chapter 3 does not load the arms
    from p2l.contracts.option import Option
    from p2l.contracts.symbols import Symbols
    from p2l.contracts.world import World

_FACTORIES: dict[str, str] = {}
_WORLDS: dict[str, tuple[str, str]] = {}
_SYMBOLS: dict[str, str] = {}


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
    domain: Domain = _build(f"domain '{name}'", _FACTORIES[name], params)
    return domain


def register_world(name: str, *, world: str, options: str) -> None:
    """Make a manipulation world available as `name`.

    Args:
        name: as in `conf/world/<name>.yaml`.
        world: `package.module:class`; keyword parameters are those of the YAML.
        options: `package.module:function` from the world to its nominal chain.

    Raises:
        ConfigError: the name is taken by another world, or one of the two has no colon.
    """
    if ":" not in world or ":" not in options:
        raise ConfigError(f"world '{name}': write 'package.module:name', got '{world}' and '{options}'")
    if _WORLDS.setdefault(name, (world, options)) != (world, options):
        raise ConfigError(f"world '{name}' is already registered as '{_WORLDS[name][0]}'; choose another name")


def known_worlds() -> tuple[str, ...]:
    """Names of all registered worlds, sorted."""
    return tuple(sorted(_WORLDS))


def get_world(name: str, params: Mapping[str, Any] | None = None) -> World:
    """Build the world `name` with keyword parameters `params`.

    Raises:
        ConfigError: unknown world, or a parameter that it does not take or refuses.
    """
    world: World = _build(f"world '{name}'", _known_world(name)[0], params)
    return world


def get_options(name: str, world: World) -> tuple[Option, ...]:
    """The nominal chain of a world, in order.

    Raises:
        ConfigError: unknown world.
    """
    make: Callable[[World], tuple[Option, ...]] = _load(_known_world(name)[1])
    return make(world)


def register_symbols(name: str, symbols: str) -> None:
    """Describe a world to the skill graph: `symbols` (`package.module:class`) takes the world."""
    _SYMBOLS[name] = symbols


def described_worlds() -> tuple[str, ...]:
    """Names of all worlds that have symbols, sorted."""
    return tuple(sorted(_SYMBOLS))


def get_symbols(name: str, world: World) -> Symbols:
    """How a world is described to preconditions and recoveries (chapter 4).

    Raises:
        ConfigError: nobody described it.
    """
    if name not in _SYMBOLS:
        raise ConfigError(f"world '{name}' has no symbols, so no skill graph; worlds that have: {', '.join(_SYMBOLS)}")
    make: Callable[[World], Symbols] = _load(_SYMBOLS[name])
    return make(world)


def _known_world(name: str) -> tuple[str, str]:
    if name not in _WORLDS:
        raise ConfigError(f"unknown world '{name}'; known worlds: {', '.join(known_worlds()) or 'none'}")
    return _WORLDS[name]


def _load(path: str) -> Any:
    module, _, attribute = path.partition(":")
    return getattr(importlib.import_module(module), attribute)


def _build(what: str, path: str, params: Mapping[str, Any] | None) -> Any:
    factory: Callable[..., Any] = _load(path)
    given = dict(params or {})
    allowed = tuple(inspect.signature(factory).parameters)
    if unknown := sorted(set(given) - set(allowed)):
        raise ConfigError(f"{what}: unknown parameters {unknown}; allowed: {', '.join(allowed) or 'none'}")
    return factory(**given)


register("board", "p2l.domains.insertion.domain:board")
register("insertion", "p2l.domains.insertion.domain:insertion")
register("lego", "p2l.domains.lego.domain:Lego")

register_world("door", world="p2l.worlds.door.world:Door", options="p2l.worlds.door.skills:options")
register_world(
    "pick_place", world="p2l.worlds.pick_place.world:PickPlace", options="p2l.worlds.pick_place.skills:options"
)
register_world("shelf", world="p2l.worlds.shelf.world:Shelf", options="p2l.worlds.shelf.skills:options")
register_world(
    "cluttered_shelf", world="p2l.worlds.shelf.world:ClutteredShelf", options="p2l.worlds.shelf.skills:options"
)

register_symbols("door", "p2l.worlds.door.symbols:DoorSymbols")

"""The manipulation worlds of chapters 4 and 5 by name; the contract tests run each of them.

A new one of ours adds a function and a line; one of another package needs neither (`p2l.registry`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from p2l.artifacts import config_hash
from p2l.closure import outside_code
from p2l.contracts.world import World
from p2l.registry import Registry


def _door() -> Callable[..., World]:
    from p2l.worlds.door.world import Door

    return Door


def _nut() -> Callable[..., World]:
    from p2l.worlds.nut.world import Nut

    return Nut


def _pick_place() -> Callable[..., World]:
    from p2l.worlds.pick_place.world import PickPlace

    return PickPlace


def _shelf() -> Callable[..., World]:
    from p2l.worlds.shelf.world import Shelf

    return Shelf


def _cluttered_shelf() -> Callable[..., World]:
    from p2l.worlds.shelf.world import ClutteredShelf

    return ClutteredShelf


WORLDS: Registry[Callable[..., World]] = Registry(
    "world",
    {"door": _door, "nut": _nut, "pick_place": _pick_place, "shelf": _shelf, "cluttered_shelf": _cluttered_shelf},
)


def make_world(name: str, params: Mapping[str, Any] | None = None) -> World:
    """A world by name, or by target (`package.module:Class`), with keyword parameters `params`.

    Raises:
        ConfigError: unknown world, or a parameter that it does not take or refuses.

    Example:
        >>> from p2l import make_world
        >>> world = make_world("door", {"estimator": "exact", "nthread": 1})
        >>> [option.name for option in world.nominal_options()]
        ['reach_and_grasp', 'rotate_handle', 'pull_handle']
    """
    factory = WORLDS.factory_for(name, params)
    with WORLDS.given(name, factory, params):
        made = factory(**dict(params or {}))
    world = WORLDS.expect(name, made, World)
    module = (WORLDS.target(name) or "").partition(":")[0]
    if module and module != type(world).__module__ and isinstance(vars(world).get("digest"), str):
        # What a function does to a world after it was made is in the function's code alone.
        world.digest = config_hash([world.digest, outside_code([module])])  # type: ignore[misc]
    return world

"""Chapter 3's task distributions by name; the contract tests run each of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from p2l.contracts.domain import Domain
from p2l.registry import Registry


def _board() -> Callable[..., Domain]:
    from p2l.domains.insertion.factory import board

    return board


def _insertion() -> Callable[..., Domain]:
    from p2l.domains.insertion.factory import insertion

    return insertion


def _insertion_continuous() -> Callable[..., Domain]:
    from p2l.domains.insertion.factory import insertion_continuous

    return insertion_continuous


def _lego() -> Callable[..., Domain]:
    from p2l.domains.lego.domain import Lego

    return Lego


DOMAINS: Registry[Callable[..., Domain]] = Registry(
    "domain",
    {"board": _board, "insertion": _insertion, "insertion_continuous": _insertion_continuous, "lego": _lego},
)


def make_domain(name: str, params: Mapping[str, Any] | None = None) -> Domain:
    """A domain by name, or by target (`package.module:Class`), with keyword parameters `params`.

    Raises:
        ConfigError: unknown domain, or a parameter that it does not take or refuses.

    Example:
        >>> import numpy as np
        >>> from p2l import make_domain
        >>> lego = make_domain("lego")
        >>> len(lego.sample_set(np.random.default_rng(0), 10))
        10
    """
    factory = DOMAINS.factory_for(name, params)
    with DOMAINS.given(name, factory, params):
        made = factory(**dict(params or {}))
    return DOMAINS.expect(name, made, Domain)

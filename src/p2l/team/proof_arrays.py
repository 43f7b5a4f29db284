"""A certificate as arrays, for the files of plans, and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from p2l.team.problem import Certificate

_ALWAYS = ("multipliers", "row", "parent", "facility", "is_open")
_TARGET, _PRICES, _COUNT_PRICES = "target", "prices", "count_prices"  # prices where there are any


def to_arrays(certificate: Certificate, prefix: str = "") -> dict[str, Any]:
    """All of a certificate by name, after a prefix."""
    count_prices = certificate.count_prices
    assert count_prices is not None
    arrays: dict[str, Any] = {prefix + name: np.asarray(getattr(certificate, name)) for name in _ALWAYS}
    arrays[prefix + _TARGET] = np.array(certificate.target)
    if certificate.prices.size:
        arrays[prefix + _PRICES] = certificate.prices
    if count_prices.any():
        arrays[prefix + _COUNT_PRICES] = count_prices
    return arrays


def from_arrays(arrays: Mapping[str, Any], prefix: str = "") -> Certificate:
    """The certificate of which `to_arrays` made these.

    Raises:
        KeyError, ValueError, ShapeError: it made none of them.
    """
    target = arrays[prefix + _TARGET]
    if target.shape:
        raise ValueError("its target is no number")
    rest = {name: arrays[prefix + name] for name in (_PRICES, _COUNT_PRICES) if prefix + name in arrays}
    return Certificate(**{name: arrays[prefix + name] for name in _ALWAYS}, target=float(target), **rest)

"""The insertion and board domains from plain configuration values.

Without `encoding` a domain has the one that was best for its layout on other seeds than those that are reported
(`results/thesis/tables/predictor_choice.csv`); for the board, which is easy, it is the thesis's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, TypeVar, get_args

import numpy as np

from p2l.contracts.domain import Encoding
from p2l.domains.insertion.demonstration import Demonstration
from p2l.domains.insertion.domain import InsertionDomain, Layout, RepsSettings
from p2l.domains.insertion.physics import InsertionPhysics
from p2l.errors import ConfigError

T = TypeVar("T")
ENCODINGS: dict[Layout, Encoding] = {"grid": "walls", "board": "difference", "continuous": "walls"}


def insertion(
    *,
    layout: Layout = "grid",
    physics: Mapping[str, Any] | None = None,
    noise_std: float = 0.003,
    layout_seed: int = 0,
    farthest_wall_cm: float = 2.0,
    board_distance_m: Sequence[float] = (0.007, 0.025),
    reps: Mapping[str, Any] | None = None,
    demonstration: Mapping[str, Any] | None = None,
    nthread: int = 2,
    encoding: Encoding | None = None,
) -> InsertionDomain:
    """Build an insertion domain from plain configuration values; nested settings are mappings.

    Raises:
        ConfigError: an unknown or impossible setting, with the allowed names.
    """
    if layout not in ENCODINGS:
        raise ConfigError(f"insertion: unknown layout '{layout}'; known layouts: {', '.join(ENCODINGS)}")
    if encoding not in (None, *get_args(Encoding)):
        raise ConfigError(f"insertion: unknown encoding '{encoding}'; known ones: {', '.join(get_args(Encoding))}")
    numbers = [noise_std, farthest_wall_cm, layout_seed, nthread, *board_distance_m]
    if not all(isinstance(number, (int, float)) and 0.0 <= number < np.inf for number in numbers) or nthread < 1:
        raise ConfigError(f"insertion: noise_std, walls, seed, nthread, distances: {numbers} must be finite numbers")
    low, high = (float(value) for value in board_distance_m)
    if not 0.0 < low < high:
        raise ConfigError(f"insertion: board_distance_m {board_distance_m} must be a rising range above 0")
    return InsertionDomain(
        layout=layout,
        physics=_settings(InsertionPhysics, physics),
        noise_std=float(noise_std),
        layout_seed=int(layout_seed),
        farthest_wall_cm=float(farthest_wall_cm),
        board_distance_m=(low, high),
        reps=_settings(RepsSettings, reps),
        demonstration=_settings(Demonstration, demonstration),
        nthread=int(nthread),
        encoding=encoding or ENCODINGS[layout],
    )


def insertion_continuous(
    *,
    physics: Mapping[str, Any] | None = None,
    noise_std: float = 0.003,
    layout_seed: int = 0,
    farthest_wall_cm: float = 2.0,
    reps: Mapping[str, Any] | None = None,
    demonstration: Mapping[str, Any] | None = None,
    nthread: int = 2,
    encoding: Encoding | None = None,
) -> InsertionDomain:
    """Build `insertion` with slots anywhere in the middle of a cell instead of on a lattice."""
    return insertion(
        layout="continuous",
        physics=physics,
        noise_std=noise_std,
        layout_seed=layout_seed,
        farthest_wall_cm=farthest_wall_cm,
        reps=reps,
        demonstration=demonstration,
        nthread=nthread,
        encoding=encoding,
    )


def board(
    *,
    physics: Mapping[str, Any] | None = None,
    noise_std: float = 0.003,
    board_distance_m: Sequence[float] = (0.007, 0.025),
    reps: Mapping[str, Any] | None = None,
    demonstration: Mapping[str, Any] | None = None,
    nthread: int = 2,
    encoding: Encoding | None = None,
) -> InsertionDomain:
    """Build the peg board of table 3.1: `insertion` with holes instead of slots and a round tip."""
    return insertion(
        layout="board",
        physics={"tip": "peg", **(physics or {})},
        noise_std=noise_std,
        board_distance_m=board_distance_m,
        reps=reps,
        demonstration=demonstration,
        nthread=nthread,
        encoding=encoding,
    )


def _settings(kind: type[T], values: Mapping[str, Any] | None) -> T:
    """The record of a kind with these values, the defaults elsewhere."""
    defaults = {item.name: item.default for item in fields(kind)}  # type: ignore[arg-type]
    if unknown := sorted(set(values or {}) - set(defaults)):
        raise ConfigError(f"insertion: unknown {kind.__name__} settings {unknown}; allowed: {', '.join(defaults)}")
    for name, value in (values or {}).items():
        if isinstance(defaults[name], str):
            continue  # the tip, which `build_model` checks
        whole = isinstance(defaults[name], int)
        if isinstance(value, bool) or not isinstance(value, int if whole else (int, float)) or not 0 <= value < np.inf:
            kind_of = "whole number" if whole else "finite number"
            raise ConfigError(f"insertion: {kind.__name__}.{name} is {value!r}; it must be a {kind_of} of at least 0")
    return kind(**(values or {}))

"""Instances of known structure for the benchmarks: geometric team problems and classic facility location families."""

from __future__ import annotations

import numpy as np

from p2l.records import Array
from p2l.team import Problem
from p2l.team.problem import Order

REACH = {"wide": 0.3, "local": 0.035}  # transfer is exp(-distance / reach); a lesson is useful above 0.1


def geometric(n: int, kind: str, rng: np.random.Generator, order: Order = "fixed") -> Problem:
    """Random tasks in the unit square, costs 10/100/100/200; "wide" lessons help most tasks, "local" ones about 2 %."""
    place = rng.random((n, 2))
    distance = np.linalg.norm(place[:, None] - place[None, :], axis=2)
    return Problem(
        tasks=tuple(f"task {i}" for i in range(n)),
        c_rob=np.full(n, 10.0),
        c_hum=np.full(n, 100.0),
        c_fail=np.full(n, 100.0),
        c_demo=np.full(n, 200.0),
        pretrained=np.zeros(n),
        transfer=np.exp(-distance / REACH[kind]),
        order=order,
    )


def warehouses(facilities: int, demands: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Like OR-Library's capa-capc: cost = demand times distance."""
    plants, customers = rng.random((facilities, 2)), rng.random((demands, 2))
    distance = np.linalg.norm(customers[:, None] - plants[None, :], axis=2)
    weight = rng.integers(1, 100, demands)
    return rng.uniform(200.0, 800.0, facilities), weight[:, None] * distance * 10.0


def euclidean(size: int, rng: np.random.Generator, divisor: float = 10.0) -> tuple[Array, Array]:
    """Like the MED (k-median) family: every point is both; opening costs sqrt(size) x 10 000 / divisor."""
    place = rng.random((size, 2))
    distance = np.linalg.norm(place[:, None] - place[None, :], axis=2)
    return np.full(size, np.sqrt(size) / divisor * 1e4), np.round(distance * 1e4)


def dense(size: int, kind: str, rng: np.random.Generator) -> tuple[Array, Array]:
    """Like Koerkel and Ghosh: service 1000-2000 at random; opening 100-200 (a), 1000-2000 (b), 10 000-20 000 (c)."""
    low = {"a": 100, "b": 1000, "c": 10_000}[kind]
    opening = rng.integers(low, 2 * low + 1, size).astype(float)
    return opening, rng.integers(1000, 2001, (size, size)).astype(float)


def many_optima(size: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Like the M* family of Kratica and others: random service costs, opening costs that make many plans nearly tie."""
    service = rng.uniform(0.0, 1.0, (size, size)) * rng.uniform(5.0, 30.0, size)[None, :]
    return rng.uniform(10.0, 25.0, size), service

"""Instances of known structure: geometric team problems and shops, and classic facility location families."""

from __future__ import annotations

import math

import numpy as np

from p2l.records import Array
from p2l.team import Problem
from p2l.team.problem import Order
from p2l.team.shop import Shop

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


def large_shop(
    n: int,
    robots: int = 1,
    *,
    seed: int = 0,
    counts: bool = True,
    arcs: int = 0,
    order: Order = "fixed",
    max_lessons: float = math.inf,
    max_teaching: float = math.inf,
) -> Shop:
    """Tasks in a square of four features; a lesson carries over to what is near, a bit less with each robot.

    Args:
        n: tasks.
        robots: who can be taught.
        seed: of the draws.
        counts: whether three tasks in ten come two to five times.
        arcs: of a partial order; 0 for none.
        order: where there are no arcs.
        max_lessons: as in `Shop`.
        max_teaching: as in `Shop`.
    """
    rng = np.random.default_rng(seed)
    place = rng.random((n, 4))
    distance = np.linalg.norm(place[:, None] - place[None], axis=-1)
    pairs: set[tuple[int, int]] = set()
    rank = rng.permutation(n)
    while len(pairs) < arcs:
        one, other = sorted(rng.choice(n, 2, replace=False).tolist())
        pairs.add((int(rank[one]), int(rank[other])))
    names = tuple(f"task {i}" for i in range(n))
    return Shop(
        tasks=names,
        robots=tuple(f"robot {i}" for i in range(robots)),
        lessons=names,
        completes=np.arange(n),
        count=np.where(rng.random(n) < 0.3, rng.integers(2, 6, n), 1) if counts else np.ones(n, dtype=np.int64),
        c_hum=rng.uniform(80, 120, n).round(1),
        c_rob=rng.uniform(8, 15, (robots, n)).round(1),
        c_fail=rng.uniform(80, 120, (robots, n)).round(1),
        pretrained=np.zeros((robots, n)),
        c_demo=rng.uniform(150, 250, (robots, n)).round(1),
        transfer=np.exp(-3.0 * distance)[None] * rng.uniform(0.8, 1.0, (robots, 1, 1)),
        choice=np.full(n, -1),
        order="partial" if arcs else order,
        before=np.array(sorted(pairs)) if arcs else None,
        max_lessons=max_lessons,
        max_teaching=max_teaching,
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

"""Made-up todays and tomorrows: small ones for the oracle, large ones for the searches."""

from dataclasses import replace

import numpy as np
from shop_instances import small_shop

from p2l.team.shop import Shop
from p2l.team.tomorrow import TwoStage


def small_program(rng, order, commit="today"):
    """Every feature at once, sometimes; small enough to try every plan."""
    shop = small_shop(rng, order)
    while len(shop.lessons) * len(shop.robots) > 5 or len(shop.groups[0]) > 4:
        shop = small_shop(rng, order)
    robots, lessons = len(shop.robots), len(shop.lessons)
    types, scenarios = int(rng.integers(1, 4)), int(rng.integers(1, 4))

    def cost(shape, never=0.1):
        return np.where(rng.random(shape) < never, np.inf, rng.integers(1, 100, shape).astype(float))

    own = np.full(types, -1)
    taught = rng.permutation(lessons)[: int(rng.integers(0, min(types, lessons) + 1))]
    own[: len(taught)] = taught
    weight = rng.integers(1, 5, scenarios)
    counts = rng.integers(0, 4, (scenarios, types)) * np.where(rng.random() < 0.3, 0.4, 1.0)
    return TwoStage(
        today=shop,
        types=tuple(f"type {j}" for j in range(types)),
        lesson=rng.permutation(own),
        c_hum=cost(types, 0.15),
        c_rob=cost((robots, types)),
        c_fail=cost((robots, types)),
        pretrained=rng.random((robots, types)) * (rng.random((robots, types)) < 0.3),
        c_demo=cost((robots, lessons)),
        transfer=rng.random((robots, lessons, types)).round(2),
        counts=counts,
        probability=weight / weight.sum(),
        commit=commit,
    )


def large_program(n, scenarios, *, seed=0, mean=1.0, c_demo=200.0, commit="today", order="any"):
    """Tasks in a square of features, each once today and a Poisson number of times tomorrow."""
    rng = np.random.default_rng(seed)
    place = rng.random((n, 2))
    distance = np.linalg.norm(place[:, None] - place[None], axis=-1)
    names = tuple(f"task {i}" for i in range(n))
    shop = Shop(
        tasks=names, robots=("arm",), lessons=names, completes=np.arange(n), count=np.ones(n, dtype=np.int64),
        c_hum=rng.uniform(80, 120, n).round(1), c_rob=np.full((1, n), 10.0), c_fail=np.full((1, n), 100.0),
        pretrained=np.zeros((1, n)), c_demo=np.full((1, n), c_demo), transfer=np.exp(-4 * distance)[None],
        choice=np.full(n, -1), order=order,
    )  # fmt: skip
    return of_shop(shop, rng.poisson(mean, (scenarios, n)), commit)


def of_shop(shop, counts, commit="today", probability=None):
    """Tomorrow's types are today's tasks, at today's costs."""
    scenarios = len(counts)
    return TwoStage(
        today=shop, types=shop.tasks, lesson=np.arange(shop.n), c_hum=shop.c_hum, c_rob=shop.c_rob,
        c_fail=shop.c_fail, pretrained=shop.pretrained, c_demo=shop.c_demo, transfer=shop.transfer, counts=counts,
        probability=np.full(scenarios, 1 / scenarios) if probability is None else probability, commit=commit,
    )  # fmt: skip


def one_scenario(program, scenario):
    """Tomorrow as one of its scenarios, for sure."""
    return replace(program, counts=program.counts[[scenario]], probability=np.ones(1))

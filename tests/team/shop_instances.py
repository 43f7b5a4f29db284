"""Made-up shops, small enough for the oracle."""

import numpy as np

from p2l.team.shop import Shop


def small_shop(rng, order):
    """Every feature at once, sometimes; small enough to try every plan."""
    n, robots, extra = int(rng.integers(2, 5)), int(rng.integers(1, 3)), int(rng.integers(0, 2))
    lessons = n + extra
    if order == "partial":
        n, robots = min(n, 4), 1

    def cost(shape, never=0.1):
        drawn = rng.integers(1, 100, shape).astype(float)
        return np.where(rng.random(shape) < never, np.inf, drawn)

    count = np.where(rng.random(n) < 0.3, rng.integers(2, 4, n), 1)
    while (count > 1).sum() + n > (4 if order == "partial" else 5):
        count[rng.integers(n)] = 1
    lessons = n + extra
    place = rng.permutation(n)
    arcs = [(place[i], place[j]) for i in range(n) for j in range(i + 1, n) if rng.random() < 0.4]
    return Shop(
        tasks=tuple(f"task {i}" for i in range(n)),
        robots=tuple(f"robot {i}" for i in range(robots)),
        lessons=tuple(f"lesson {i}" for i in range(lessons)),
        completes=np.concatenate([rng.permutation(n), np.full(extra, -1)]),
        count=count,
        c_hum=cost(n, 0.15),
        c_rob=cost((robots, n)),
        c_fail=cost((robots, n)),
        pretrained=rng.random((robots, n)) * (rng.random((robots, n)) < 0.3),
        c_demo=cost((robots, lessons)),
        transfer=rng.random((robots, lessons, n)).round(2),
        choice=np.where(rng.random(n) < 0.2, rng.integers(0, 4, n), -1),
        order=order,
        before=np.array(arcs, dtype=np.int64).reshape(-1, 2) if order == "partial" else None,
        max_lessons=float(rng.integers(0, 3)) if rng.random() < 0.4 else np.inf,
        max_teaching=float(rng.integers(0, 150)) if rng.random() < 0.4 else np.inf,
    )

"""Days for the figure and the page of a shop."""

import numpy as np

from p2l.team.shop import Shop


def day(n=6, robots=("arm",), courses=0, counts=1, order="fixed", tasks=None, seed=0, **changes):
    """A day whose tasks lie in a square, where a lesson helps what is near; `courses` complete none of the tasks."""
    random = np.random.default_rng(seed)
    place = random.random((n + courses, 2))
    near = np.exp(-np.linalg.norm(place[:, None] - place[None, :n], axis=2) / 0.4)
    tasks = tasks or tuple(f"task {i}" for i in range(n))
    many = len(robots)
    given = {
        "tasks": tasks,
        "robots": robots,
        "lessons": (*tasks, *(f"course {i}" for i in range(courses))),
        "completes": np.r_[np.arange(n), np.full(courses, -1)],
        "count": np.full(n, counts),
        "c_hum": random.uniform(80, 120, n),
        "c_rob": random.uniform(5, 20, (many, n)),
        "c_fail": np.full((many, n), 100.0),
        "pretrained": np.full((many, n), 0.1),
        "c_demo": np.tile(np.r_[np.full(n, 150.0), np.full(courses, 60.0)], (many, 1)),
        "transfer": np.stack([near * share for share in np.linspace(1.0, 0.8, many)]),
        "choice": np.full(n, -1),
        "order": order,
    }
    return Shop(**(given | changes))

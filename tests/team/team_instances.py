"""Random instances that the team's tests share: ties, zeros and certainties are as likely as ordinary numbers."""

from itertools import product

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from p2l.errors import ShapeError
from p2l.team import Problem

probability = st.one_of(st.sampled_from([0.0, 0.1, 0.5, 0.9, 1.0]), st.floats(0.0, 1.0, width=32))
cost = st.one_of(st.sampled_from([0.0, 10.0, 100.0, 200.0]), st.floats(0.0, 300.0, width=32))


@st.composite
def problems(draw, largest=9, orders=("fixed", "any")):
    n = draw(st.integers(1, largest))
    vector = hnp.arrays(np.float64, n, elements=cost)
    return Problem(
        tasks=tuple(f"t{i}" for i in range(n)),
        c_rob=draw(vector) / 10.0,
        c_hum=draw(vector),
        c_fail=draw(vector),
        c_demo=draw(vector),
        pretrained=draw(hnp.arrays(np.float64, n, elements=probability)) * draw(st.sampled_from([0.0, 1.0])),
        transfer=draw(hnp.arrays(np.float64, (n, n), elements=probability)),
        order=draw(st.sampled_from(orders)),
    )


@st.composite
def tables(draw, facilities=7, demands=8):
    shape = draw(st.integers(1, demands)), draw(st.integers(1, facilities))
    scale = draw(st.sampled_from([1e-6, 1.0, 1e7]))
    opening = draw(hnp.arrays(np.float64, shape[1], elements=cost)) * scale
    return opening, draw(hnp.arrays(np.float64, shape, elements=cost)) * scale


def facility_cost(opening, service, open_set):
    """Equation 3.3, from scratch: opening [F] plus cheapest service [D, F]; infinite when nothing is open."""
    if not open_set.any():
        return float("inf")
    return float(opening[open_set].sum() + service[:, open_set].min(axis=1).sum())


def cheapest_by_hand(opening, service):
    """Every nonempty open set."""
    sets = (np.array(bits) for bits in product([False, True], repeat=len(opening)) if any(bits))
    return min(facility_cost(opening, service, open_set) for open_set in sets)


def thesis_set(n=10, transfer=None, pretrained=0.0, c_demo=200.0):
    """A set of section 3.5.2: costs 10 / 100 / 100 / 200, no skill carries over unless a table is given."""
    return Problem(
        tasks=tuple(f"part {i}" for i in range(n)),
        c_rob=np.full(n, 10.0),
        c_hum=np.full(n, 100.0),
        c_fail=np.full(n, 100.0),
        c_demo=np.full(n, c_demo),
        pretrained=np.full(n, pretrained),
        transfer=np.zeros((n, n)) if transfer is None else transfer,
    )


def geometric(n, seed=0):
    rng = np.random.default_rng(seed)
    place = rng.random((n, 2))
    distance = np.linalg.norm(place[:, None] - place[None], axis=2)
    return thesis_set(n, np.exp(-distance / 0.3))


def random_transfer(n, seed=1):
    """Skills that carry over at random: the relaxation is not integral."""
    return thesis_set(n, np.random.default_rng(seed).random((n, n)))


def any_scale(seed):
    """A problem of at most 9 tasks, costs of up to 18 orders of magnitude; None where nobody can do a task."""
    rng = np.random.default_rng(seed)
    n, kind = int(rng.integers(1, 10)), rng.integers(6)

    def costs():
        return [
            lambda: 10.0 ** rng.uniform(-6.0, 12.0, n),
            lambda: rng.uniform(0.0, 300.0, n) * 10.0 ** rng.integers(-6, 13),
            lambda: np.where(rng.random(n) < 0.3, 10.0 ** rng.uniform(3.0, 15.0, n), rng.uniform(0.0, 300.0, n)),
            lambda: np.where(rng.random(n) < 0.3, np.inf, rng.uniform(0.0, 300.0, n)),
            lambda: rng.choice([0.0, 10.0, 100.0, 200.0, 1e12, np.inf], n),
            lambda: np.full(n, rng.choice([10.0, 100.0, 200.0, 3e10, 1e12, 1e15])),
        ][kind]()

    def probabilities(shape):
        some = rng.choice([0.0, 0.1, 0.5, 0.9, 1.0 - 1e-9, 1.0], shape)
        return some if rng.random() < 0.5 else rng.random(shape)

    parts = [costs() for _ in range(4)]
    pretrained = probabilities(n) * rng.integers(2)
    order = ("fixed", "any")[rng.integers(2)]
    try:
        return Problem(tuple(f"t{i}" for i in range(n)), *parts, pretrained, probabilities((n, n)), order)
    except ShapeError:
        return None


def dense(size, kind, seed):
    """Like Koerkel and Ghosh: random service costs, opening costs of three magnitudes, large gaps."""
    rng = np.random.default_rng(seed)
    low = {"a": 100, "b": 1000, "c": 10_000}[kind]
    opening = rng.integers(low, 2 * low + 1, size).astype(float)
    return opening, rng.integers(1000, 2001, (size, size)).astype(float)


def covering(seed, places=60):
    """Every facility serves ten demands, almost for nothing, and costs 3000 to open: gaps of a quarter."""
    rng = np.random.default_rng(seed)
    service = np.full((places, places), 60_000.0)
    for j in range(places):
        service[rng.choice(places, 10, replace=False), j] = rng.integers(0, 5, 10)
    return np.full(places, 3000.0), service

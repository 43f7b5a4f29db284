"""Small made-up shops whose truth is known: for tests."""

import numpy as np
from scipy.special import expit

from p2l.transfer.few_trials import Prior, TaskTable, Trials
from p2l.transfer.pair_models import FitSetting


def table(rng, m=20, families=5):
    """Tasks with two numbers, a material and a family."""
    numeric = np.column_stack([rng.normal(size=m), np.exp(rng.normal(size=m))])
    category, family = rng.integers(0, 3, (m, 1)), np.arange(m) % families
    names = tuple(f"t{number}" for number in range(m))
    return TaskTable(names, ("size", "fit"), numeric, ("material",), category, family)


def truth(tasks, rng, own=0.4):
    """[M, M] success: family first, then size; each pair has a little of its own."""
    other = tasks.family[:, None] != tasks.family
    distance = np.abs(tasks.numeric[:, None, 0] - tasks.numeric[None, :, 0])
    return expit(2.0 - 2.5 * other - 1.2 * distance + own * rng.standard_normal(other.shape))


def tried(p, rng, pairs=60, attempts=4):
    """Trials of pairs drawn at random."""
    m = len(p)
    taught, tested = np.divmod(rng.choice(m * m, pairs, replace=False), m)
    n = rng.integers(1, attempts + 1, pairs)
    return Trials.pooled(taught, tested, rng.binomial(n, p[taught, tested]), n)


def setting(tasks, members=20, **prior):
    """Tasks with the default prior."""
    return FitSetting(tasks, Prior(**prior), members)

"""Graphs, learning curves and runs that the tests of this room share."""

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from p2l.metareskill.algorithm import learn
from p2l.metareskill.choosers.table import make_chooser
from p2l.metareskill.graph import SkillGraph
from p2l.metareskill.history import History, Round, Trained
from p2l.metareskill.value_iteration import value_of_failures


@st.composite
def graphs(draw, max_nominal=4, max_modes=5):
    k, n = draw(st.integers(1, max_nominal)), draw(st.integers(1, max_modes))
    unit = st.floats(0.0, 1.0)
    return SkillGraph(
        nominal=draw(hnp.arrays(float, k, elements=unit)),
        sizes=draw(hnp.arrays(float, n, elements=st.integers(1, 500).map(float))),
        q=draw(hnp.arrays(float, (n, k + 1), elements=unit)),
        skill_reward=draw(st.floats(-3.0, 0.0)),
        recovery_reward=draw(st.floats(-3.0, 0.0)),
        c_fail=draw(st.floats(0.5, 20.0)),
    )


def fresh(modes=5, nominal=(0.95, 0.95, 0.95), sizes=None):
    sizes = np.arange(modes, 0, -1) * 100.0 if sizes is None else np.asarray(sizes, float)
    return SkillGraph(np.asarray(nominal), sizes, np.zeros((len(sizes), len(nominal) + 1)))


def saturating(rng, graph, rounds, trials=50):
    """[I, M, rounds] success rates measured on `trials` failures; half of the recoveries hardly work."""
    shape = graph.q.shape
    ceiling = np.where(rng.random(shape) < 0.5, rng.uniform(0.3, 1.0, shape), rng.uniform(0.0, 0.1, shape))
    pace = rng.uniform(2.0, 12.0, shape)
    rate = ceiling[..., None] * (1.0 - np.exp(-np.arange(1, rounds + 1) / pace[..., None]))
    return rng.binomial(trials, rate) / trials


def replayed(curves):
    return lambda mode, target, attempt: Trained(float(curves[mode, target, attempt]), trials=50)


def run(graph, name, recorded, rounds, seed=0, /, **params):
    """The history of a whole loop on recorded curves."""
    rng = np.random.Generator(np.random.PCG64(seed))
    *_, last = learn(graph, make_chooser(name, params), replayed(recorded), rounds=rounds, rng=rng)
    return last


def written(graph, measured):
    """A history of rounds ((mode, target), q), as a person would write it down."""
    rounds, best = [], graph.q.copy()
    for pair, q in measured:
        before = float(best[pair])
        best[pair] = max(before, q)
        value = float(value_of_failures(graph, best))
        rounds.append(Round(*pair, "by hand", before, np.nan, np.nan, q, 10, True, value))
    return History(graph.q, tuple(rounds))

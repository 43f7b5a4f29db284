import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from p2l.artifacts import load_arrays, save_arrays
from p2l.errors import ConfigError, ShapeError
from p2l.metareskill.graph import SkillGraph
from p2l.metareskill.value_iteration import (
    NONE,
    backup,
    best_recovery,
    greedy,
    nominal_policy,
    predicted_value,
    recovery_values,
    value_iteration,
    value_of_failures,
)
from tests.metareskill.skill_graphs import fresh, graphs


def recovery_policy(graph):
    """[I] the best one from each mode; `NONE` where giving up is worth as much as that, or nothing succeeds."""
    first = best_recovery(graph, np.arange(len(graph.q)), np.zeros_like(graph.q, dtype=int), np.zeros_like(graph.q))
    worth = recovery_values(graph, value_iteration(graph).targets)[np.arange(len(first)), first]
    return np.where((first != NONE) & (worth > -graph.c_fail), first, NONE)


def by_linear_solve(graph, policy):
    """Values of following `policy`, from (I − P) V = R over states ρ_1 … ρ_K, goal, modes; `NONE` gives up."""
    k, n = len(graph.nominal), len(graph.sizes)
    transition, reward = np.zeros((k + 1 + n, k + 1 + n)), np.zeros(k + 1 + n)
    for j, p in enumerate(graph.nominal):
        transition[j, j + 1] = p
        reward[j] = graph.skill_reward - (1 - p) * graph.c_fail
    for i, j in enumerate(policy):
        reward[k + 1 + i] = -graph.c_fail
        if j != NONE:
            transition[k + 1 + i, j] = graph.q[i, j]
            reward[k + 1 + i] = graph.recovery_reward - (1 - graph.q[i, j]) * graph.c_fail
    values = np.linalg.solve(np.eye(k + 1 + n) - transition, reward)
    return values[: k + 1], values[k + 1 :]


@given(graphs())
def test_value_iteration_is_a_bellman_fixed_point(graph):
    values = value_iteration(graph)
    again = backup(graph, values)
    np.testing.assert_array_equal(again.targets, values.targets)
    np.testing.assert_array_equal(again.modes, values.modes)
    assert values.targets[-1] == 0.0
    assert values.modes.min() >= -graph.c_fail


@given(graphs())
def test_it_is_the_exact_value_of_its_greedy_policy(graph):
    targets, modes = by_linear_solve(graph, recovery_policy(graph))
    values = value_iteration(graph)
    np.testing.assert_allclose(values.targets, targets, atol=1e-9)
    np.testing.assert_allclose(values.modes, modes, atol=1e-9)


@given(graphs(max_nominal=2, max_modes=3))
def test_no_policy_is_better(graph):
    options = [NONE, *range(len(graph.nominal) + 1)]
    best = np.max([by_linear_solve(graph, p)[1] for p in itertools.product(options, repeat=len(graph.sizes))], axis=0)
    np.testing.assert_allclose(value_iteration(graph).modes, best, atol=1e-9)


@given(graphs(), st.data())
def test_the_value_of_failures_rises_with_every_success_probability(graph, data):
    other = data.draw(hnp.arrays(float, graph.q.shape, elements=st.floats(0.0, 1.0)))
    assert value_of_failures(graph, np.maximum(graph.q, other)) >= value_of_failures(graph) - 1e-12


@given(graphs(), st.data())
def test_predictions_are_the_values_of_the_replaced_graphs(graph, data):
    upper = data.draw(hnp.arrays(float, graph.q.shape, elements=st.floats(0.0, 1.0)))
    pairs = graph.q.size
    replaced = np.tile(graph.q, (pairs, 1, 1))
    replaced[(np.arange(pairs), *np.unravel_index(np.arange(pairs), graph.q.shape))] = upper.ravel()
    batch = value_of_failures(graph, replaced)
    np.testing.assert_allclose(predicted_value(graph, upper).ravel(), batch, atol=1e-9)
    np.testing.assert_allclose([value_of_failures(graph.with_q(q)) for q in replaced], batch, atol=1e-12)


def test_two_modes_two_targets_by_hand():
    """V(ρ_1) = −1 + 0.9 · 0 − 0.1 · 10 = −2. Mode 0: to ρ_1 −1 + 0.8 · (−2) − 0.2 · 10 = −4.6, to the goal
    −1 + 0.5 · 0 − 0.5 · 10 = −6. Mode 1: −1 + 0.05 · (−2) − 9.5 = −10.6 and −1 − 10, so it gives up at −10.
    VoF = 3/4 · (−4.6) + 1/4 · (−10) = −5.95."""
    graph = SkillGraph(np.array([0.9]), np.array([300, 100]), np.array([[0.8, 0.5], [0.05, 0.0]]))
    values = value_iteration(graph)
    np.testing.assert_allclose(values.targets, [-2.0, 0.0])
    np.testing.assert_allclose(values.modes, [-4.6, -10.0])
    assert value_of_failures(graph) == pytest.approx(-5.95)
    np.testing.assert_array_equal(recovery_policy(graph), [0, NONE])


def test_the_best_recovery_is_the_most_valuable_and_gives_way_the_more_often_it_was_executed():
    """V(ρ_1) = −2. Mode 0: −4.6 to ρ_1, −6 to the goal. After one execution q is 0.4 instead of 0.8, hence −7.8 to ρ_1;
    after one of each 0.25 instead of 0.5, hence −8.5 to the goal. Mode 1: −7 and −2. Mode 2: −10.6, below giving up,
    and still the only one there is, however often it was executed. Mode 3 has none."""
    q = np.array([[0.8, 0.5], [0.5, 0.9], [0.05, 0.0], [0.0, 0.0]])
    graph = SkillGraph(np.array([0.9]), np.ones(4), q)
    mode = np.array([0, 1, 2, 3, 0, 0, 2])
    executed = np.array([[0, 0]] * 4 + [[1, 0], [1, 1], [5, 0]])
    found = best_recovery(graph, mode, executed, np.zeros((4, 2)))
    np.testing.assert_array_equal(found, [0, 1, 0, NONE, 1, 0, 0])
    tied = graph.with_q(np.tile([0.8, 0.64], (4, 1)))  # both worth −4.6
    order = np.array([[0.1, 0.2], [0.2, 0.1], [0.0, 0.9], [0.9, 0.0]])
    np.testing.assert_array_equal(best_recovery(tied, np.arange(4), np.zeros((4, 2), dtype=int), order), [1, 0, 1, 0])


def test_the_formula_of_the_thesis_is_a_setting_away():
    """Section 4.3.3: V = max_j q V(ρ_j) − (1 − q) c_fail, and −c_fail before any training."""
    q = np.array([[0.8, 0.5], [0.05, 0.0]])
    graph = SkillGraph(np.array([0.9]), np.array([1, 1]), q, recovery_reward=0.0)
    literal = (q * [-2.0, 0.0] - (1 - q) * 10.0).max(axis=1)
    np.testing.assert_allclose(value_iteration(graph).modes, literal)
    assert value_of_failures(graph, np.zeros_like(q)) == -10.0


def test_a_disconnected_mode_is_worth_its_penalty_and_gives_up():
    graph = fresh(3).with_q(np.array([[0.0] * 4, [0.0, 0.0, 0.0, 0.9], [0.0] * 4]))
    np.testing.assert_allclose(value_iteration(graph).modes, [-10.0, -2.0, -10.0])
    np.testing.assert_array_equal(recovery_policy(graph), [NONE, 3, NONE])


def test_ties_are_broken_at_random_and_only_ties():
    scores = np.tile([1.0, 1.0005, 0.99], (4000, 1))
    share = np.bincount(greedy(scores, np.random.default_rng(0)), minlength=3) / 4000
    np.testing.assert_allclose(share, [0.5, 0.5, 0.0], atol=0.03)
    assert (greedy(scores, np.random.default_rng(0), tie=0.0) == 1).all()


def test_the_nominal_skill_nearest_to_the_goal_is_executed():
    holds = np.array([[1, 1, 0, 0], [1, 0, 0, 1], [0, 0, 0, 0]], dtype=bool)
    np.testing.assert_array_equal(nominal_policy(fresh(), holds, np.random.default_rng(0)), [1, 3, NONE])


def test_a_graph_survives_storage(tmp_path):
    graph = fresh(2)
    save_arrays(tmp_path / "graph.npz", graph.arrays(), schema="skill_graph", version=1)
    back = SkillGraph.from_arrays(load_arrays(tmp_path / "graph.npz", schema="skill_graph", version=1))
    for name, array in graph.arrays().items():
        np.testing.assert_array_equal(back.arrays()[name], array)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"sizes": np.array([3.0, 0.0])}, ShapeError, r"failure modes \[1\] are empty"),
        ({"sizes": np.zeros(0), "q": np.zeros((0, 2))}, ShapeError, "no failure mode"),
        ({"q": np.zeros((2, 3))}, ShapeError, "q: axis 1"),
        ({"q": np.full((2, 2), np.nan)}, ShapeError, "q: holds NaN"),
        ({"nominal": np.array([1.2])}, ShapeError, "nominal"),
        ({"skill_reward": 1.0}, ConfigError, "skill_reward"),
        ({"c_fail": 0.0}, ConfigError, "c_fail"),
    ],
)
def test_bad_graphs_are_refused(change, error, message):
    fields = {"nominal": np.array([0.9]), "sizes": np.array([3.0, 1.0]), "q": np.zeros((2, 2))}
    with pytest.raises(error, match=message):
        SkillGraph(**{**fields, **change})

"""Skill graphs that are no chains: branches, several ways to the goal, and skills that fall into failure modes."""

from itertools import product

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from p2l.artifacts import load_arrays, save_arrays
from p2l.errors import ConfigError, ShapeError
from p2l.metareskill.algorithm import learn
from p2l.metareskill.choosers.oracle import best_values
from p2l.metareskill.choosers.table import make_chooser
from p2l.metareskill.graph import NominalSkill, SkillGraph
from p2l.metareskill.history import Trained
from p2l.metareskill.value_iteration import NONE, best_skills, predicted_value, value_iteration, value_of_failures
from tests.metareskill.skill_graphs import graphs

UNIT = st.floats(0.0, 1.0)


@st.composite
def branching(draw):
    k, n = draw(st.integers(1, 3)), draw(st.integers(1, 2))
    skills = []
    for number in range(draw(st.integers(1, 4))):
        weights = np.array(draw(st.lists(st.integers(0, 5), min_size=k + n + 2, max_size=k + n + 2)), float)
        assume(weights.sum() > 0)
        p = weights / weights.sum()  # the last is Fail
        reaches = {j: float(p[j]) for j in range(k + 1) if p[j] > 0}
        falls = {i: float(p[k + 1 + i]) for i in range(n) if p[k + 1 + i] > 0}
        skills.append(NominalSkill(f"s{number}", draw(st.integers(0, k - 1)), reaches, falls))
    rewards = {"skill_reward": draw(st.floats(-3.0, -0.1)), "recovery_reward": draw(st.floats(-3.0, 0.0))}
    sizes = draw(hnp.arrays(float, n, elements=st.integers(1, 50).map(float)))
    q = draw(hnp.arrays(float, (n, k + 1), elements=UNIT))
    try:
        return SkillGraph.of_skills(k, skills, sizes, q=q, **rewards)
    except ConfigError:  # in circles
        assume(False)


def of_policy(graph, skill, recovery):
    """Values of always choosing `skill` [K] and `recovery` [I], by a linear solve; None if it goes in circles."""
    k, n = len(graph.nominal), len(graph.sizes)
    transition, reward = np.zeros((k + n, k + n)), np.zeros(k + n)
    for vertex, one in enumerate(skill):
        if one is None:
            reward[vertex] = -graph.c_fail
            continue
        lost = 1.0 - sum(one.reaches.values()) - sum(one.falls.values())
        reward[vertex] = graph.skill_reward - lost * graph.c_fail
        for j, p in one.reaches.items():
            if j < k:
                transition[vertex, j] = p
        for i, p in one.falls.items():
            transition[vertex, k + i] = p
    for i, j in enumerate(recovery):
        reward[k + i] = -graph.c_fail
        if j != NONE:
            reward[k + i] = graph.recovery_reward - (1 - graph.q[i, j]) * graph.c_fail
            if j < k:
                transition[k + i, j] = graph.q[i, j]
    if np.abs(np.linalg.eigvals(transition)).max() > 1.0 - 1e-6:
        return None
    return np.linalg.solve(np.eye(k + n) - transition, reward)


def all_policies(graph):
    k, n = len(graph.nominal), len(graph.sizes)
    of_vertex = [[one for one in graph.skills if one.source == vertex] or [None] for vertex in range(k)]
    return product(product(*of_vertex), product([NONE, *range(k + 1)], repeat=n))


@given(branching())
def test_values_are_those_of_the_best_policy_by_enumeration(graph):
    k = len(graph.nominal)
    solved = [values for policy in all_policies(graph) if (values := of_policy(graph, *policy)) is not None]
    best = np.max(solved, axis=0)
    values = value_iteration(graph)
    np.testing.assert_allclose(values.targets[:k], best[:k], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(values.modes, best[k:], rtol=1e-6, atol=1e-6)
    assert values.targets[-1] == 0.0


@given(branching(), st.data())
def test_predictions_are_the_values_of_the_replaced_graphs(graph, data):
    upper = data.draw(hnp.arrays(float, graph.q.shape, elements=UNIT))
    predicted = predicted_value(graph, upper)
    for pair in np.ndindex(graph.q.shape):
        q = graph.q.copy()
        q[pair] = upper[pair]
        assert predicted[pair] == pytest.approx(float(value_of_failures(graph.with_q(q))), abs=1e-9)


@given(graphs())
def test_a_chain_written_as_skills_has_the_values_of_the_chain(graph):
    assume(graph.skill_reward < 0.0)
    k = len(graph.nominal)
    skills = [NominalSkill(f"s{j}", j, {j + 1: float(p)}) for j, p in enumerate(graph.nominal)]
    rest = {name: getattr(graph, name) for name in ("q", "skill_reward", "recovery_reward", "c_fail")}
    same = SkillGraph.of_skills(k, skills, graph.sizes, **rest)
    np.testing.assert_allclose(value_iteration(same).targets, value_iteration(graph).targets, atol=1e-9)
    np.testing.assert_allclose(value_iteration(same).modes, value_iteration(graph).modes, atol=1e-9)
    for one, other in zip(same.edges, graph.edges, strict=True):
        np.testing.assert_array_equal(one, other)


def shop(q=0.0):
    """A throw that may drop the part, or two careful steps; a dropped part can be picked up again."""
    skills = [
        NominalSkill("throw", 0, {2: 0.6}, {0: 0.4}),
        NominalSkill("carry", 0, {1: 0.8}),
        NominalSkill("place", 1, {2: 0.8}),
    ]
    return SkillGraph.of_skills(2, skills, np.array([20.0]), q=np.array([[q, 0.0, 0.0]]))


def test_a_way_that_falls_into_a_mode_pays_once_its_recovery_is_good():
    """V(place) = -1 - 2 = -3. Carry: -1 + 0.8 · -3 - 2 = -5.4. Throw with a useless recovery: -1 + 0.4 · -10 = -5.

    With q = 0.9 a dropped part is worth m = -1 + 0.9 x - 1, and the throw x = -1 + 0.4 m, so x = -1.8 / 0.64.
    """
    np.testing.assert_allclose(value_iteration(shop(0.0)).targets, [-5.0, -3.0, 0.0])
    np.testing.assert_allclose(value_iteration(shop(0.9)).targets, [-1.8 / 0.64, -3.0, 0.0], atol=1e-9)
    assert best_skills(shop(0.9)) == ("throw", "place")


def train(mode, target, trainings):
    return Trained(q=(0.9, 0.2, 0.2)[target] * (1.0 - 0.5 ** (trainings + 1)), trials=20)


def test_the_loop_trains_what_opens_the_better_way():
    chooser = make_chooser("metareskill", {"initial_rounds": 2})
    *_, history = learn(shop(), chooser, train, rounds=12, rng=np.random.default_rng(0))
    assert history.counts.argmax() == 0
    assert history.rounds[-1].value > history.rounds[0].value


def test_the_oracle_s_plan_is_of_chains_only():
    with pytest.raises(ConfigError, match="oracle: knows the best plan of a chain only"):
        best_values(shop(), np.zeros((1, 3, 4)), 4)


def test_a_round_of_several_trainings_keeps_the_best_and_not_the_last():
    """The last one counted; the thesis keeps the better policy."""
    graph = SkillGraph(nominal=np.array([0.9]), sizes=np.array([3.0]), q=np.zeros((1, 2)))
    rates = (0.2, 0.7, 0.4)
    *_, history = learn(graph, make_chooser("round_robin"), lambda mode, target, count: Trained(rates[count]),
                        rounds=2, episodes=3, rng=np.random.default_rng(0))  # fmt: skip
    assert [each.q for each in history.rounds] == [0.7, 0.7]


def test_it_survives_storage(tmp_path):
    save_arrays(tmp_path / "graph.npz", shop(0.3).arrays(), schema="skill_graph", version=1)
    back = SkillGraph.from_arrays(load_arrays(tmp_path / "graph.npz", schema="skill_graph", version=1))
    assert back.skills == shop().skills


@pytest.mark.parametrize(
    ("skills", "rest", "error", "message"),
    [
        ([NominalSkill("a", 2, {2: 1.0})], {}, ShapeError, "skill 'a': source names 2; there are 0 to 1"),
        ([NominalSkill("a", 0, {3: 1.0})], {}, ShapeError, "skill 'a': reaches names 3; there are 0 to 2"),
        ([NominalSkill("a", 0, {2: 0.5}, {1: 0.1})], {}, ShapeError, "skill 'a': falls names 1; there are 0 to 0"),
        ([NominalSkill("a", 0, {2: 0.7}, {0: 0.7})], {}, ShapeError, "more than 1 together"),
        ([NominalSkill("a", 0, {1: 1.0}), NominalSkill("b", 1, {0: 1.0})], {}, ConfigError,
         r"preconditions \[0, 1\]: their skills lead to each other for ever"),
        ([NominalSkill("a", 0, {2: 1.0})], {"skill_reward": 0.0}, ConfigError, "needs skills that cost something"),
    ],
)  # fmt: skip
def test_graphs_that_lead_nowhere_are_refused(skills, rest, error, message):
    with pytest.raises(error, match=message):
        SkillGraph.of_skills(2, skills, np.array([5.0]), **rest)

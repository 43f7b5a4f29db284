"""The chooser that looks ahead: what it believes, what it expects, and when it stops."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from p2l.errors import ConfigError
from p2l.metareskill.algorithm import learn
from p2l.metareskill.choosers.curves import CurveBelief, Sharing, belief
from p2l.metareskill.choosers.lookahead import expected_rises
from p2l.metareskill.choosers.table import make_chooser
from p2l.metareskill.graph import NominalSkill, SkillGraph
from p2l.metareskill.history import History, Trained
from p2l.metareskill.value_iteration import predicted_value, value_of_failures
from tests.metareskill.skill_graphs import fresh, graphs


def history_of(graph, outcomes, trials=50):
    """Rounds with given outcomes: (mode, target, q or None where the query was not solved)."""
    todo = iter(outcomes)
    rule = replace(make_chooser("round_robin"), rule=lambda g, h, rng: _next(outcomes, len(h)))

    def train(mode, target, before):
        _, _, q = next(todo)
        best = max((o[2] or 0.0 for o in outcomes[: len(outcomes)] if o[:2] == (mode, target)), default=0.0)
        return Trained(q=0.0 if q is None else min(q, best), trials=trials, solved=q is not None)

    *_, history = learn(graph, rule, train, rounds=len(outcomes), rng=np.random.default_rng(0))
    return history


def _next(outcomes, number):
    from p2l.metareskill.choosers.contract import Choice

    mode, target, _ = outcomes[number]
    return Choice(mode, target, "given")


@given(graphs(max_nominal=2, max_modes=3), st.integers(1, 3), st.integers(0, 2**31))
def test_expected_rises_equal_those_of_every_possible_future(graph, horizon, seed):
    rng = np.random.default_rng(seed)
    shape, hypotheses = graph.q.shape, 3
    weight = rng.random((hypotheses, *shape))
    beliefs = CurveBelief(
        solved=rng.random(hypotheses),
        ceiling=rng.random(hypotheses),
        pace=rng.random(hypotheses),
        weight=weight / weight.sum(axis=0),
        start=graph.q,
        count=rng.integers(0, 3, shape).astype(float),
    )
    rises = expected_rises(graph, beliefs, horizon)
    now = graph.with_q(np.clip(beliefs.mean, 0.0, 1.0))
    for mode, target in np.ndindex(shape):

        def value(hypothesis, more, pair=(mode, target)):
            q = now.q.copy()
            start, count = graph.q[pair], beliefs.count[pair] + more
            ceiling = max(beliefs.ceiling[hypothesis], start)
            q[pair] = start + (ceiling - start) * (1.0 - beliefs.pace[hypothesis] ** count)
            return float(value_of_failures(now, q))

        expected = 0.0
        for hypothesis in range(hypotheses):
            p = beliefs.solved[hypothesis]
            for future in product([0, 1], repeat=horizon):
                chance = np.prod([p if well else 1.0 - p for well in future])
                rise = max(value(hypothesis, sum(future)) - value(hypothesis, 0), 0.0)
                expected += beliefs.weight[hypothesis, mode, target] * chance * rise
        assert rises[horizon - 1, mode, target] == pytest.approx(expected, abs=1e-9)


def test_replaced_rates_of_a_graph_with_branches_are_solved_one_by_one_too():
    skills = [
        NominalSkill("throw", 0, {2: 0.6}, falls={0: 0.3}),
        NominalSkill("carry", 0, {1: 0.9}),
        NominalSkill("place", 1, {2: 0.9}),
    ]
    graph = SkillGraph.of_skills(2, skills, np.array([20.0, 5.0]), q=np.full((2, 3), 0.2))
    upper = np.random.default_rng(0).random((2, 4, 2, 3))
    many = predicted_value(graph, upper)
    assert many.shape == upper.shape
    for place in np.ndindex(2, 4):
        assert_allclose(many[place], predicted_value(graph, upper[place]))


def test_a_belief_is_that_of_bayes_rule_where_nothing_is_shared():
    graph = fresh(modes=2, nominal=(0.9,))
    outcomes = [(0, 1, 0.4), (0, 1, None), (0, 1, 0.6)]
    alone = belief(history_of(graph, outcomes), Sharing(mode=0.0, target=0.0, rest=0.0), trust=20.0)
    rate = lambda count: np.clip(alone.ceiling * (1.0 - alone.pace**count), 0.01, 0.99)  # noqa: E731
    weight = alone.solved**2 * (1.0 - alone.solved)
    for q, count in ((0.4, 1), (0.6, 2)):
        weight = weight * (rate(count) ** q * (1.0 - rate(count)) ** (1.0 - q)) ** 20.0
    assert_allclose(alone.weight[:, 0, 1], weight / weight.sum(), rtol=1e-9)
    assert_allclose(alone.weight[:, 1, 0], 1.0 / len(alone.solved))
    assert alone.count[0, 1] == 2.0


def test_what_others_showed_is_expected_of_those_beside_them():
    graph = fresh(modes=3, nominal=(0.9, 0.9))
    outcomes = [
        (0, 2, 0.5),
        (0, 2, 0.8),
        (1, 2, 0.6),
        (1, 0, None),
        (1, 0, None),
        (1, 0, None),
        (2, 0, None),
        (2, 0, None),
    ]
    known = belief(history_of(graph, outcomes))
    ahead = (known.weight * known.solved[:, None, None] * known.rates(3)).sum(axis=0)
    assert ahead[2, 2] > 1.2 * ahead[0, 0], "the goal was reached from two modes, the first target from none"


def test_two_unsolved_first_queries_do_not_end_a_recovery():
    """Algorithm 3: the spread of two zeros is 0, the limit is q itself, and the recovery is never trained again."""
    graph = fresh(modes=1, nominal=(0.9,), sizes=[10.0])

    def train(mode, target, before):
        if target == 0:  # a little more each time, so that no prediction ties
            return Trained(q=min(0.3 + 0.005 * before, 0.5), trials=50)
        return Trained(q=0.0 if before < 2 else 0.9, trials=50, solved=before >= 2)

    *_, history = learn(
        graph, make_chooser("metareskill", {"initial_rounds": 2}), train, rounds=30, rng=np.random.default_rng(0)
    )
    assert history.counts[0, 1] == 2
    *_, ahead = learn(graph, make_chooser("lookahead"), train, rounds=60, rng=np.random.default_rng(0))
    assert ahead.best[0, 1] == 0.9
    cured = make_chooser("metareskill", {"initial_rounds": 2, "doubt": True})
    *_, back = learn(graph, cured, train, rounds=60, rng=np.random.default_rng(0))
    assert back.best[0, 1] == 0.9, "two failures leave much open"


def saturates(ceiling, pace):
    """A training whose success rate is known: ceiling · (1 − paceⁿ)."""
    return lambda mode, target, before: Trained(
        q=float(ceiling[mode, target] * (1.0 - pace ** (before + 1))), trials=1000
    )


@pytest.mark.parametrize("c_learn", [0.02, 0.1])
def test_it_does_not_stop_while_a_query_is_worth_more_than_its_cost(c_learn):
    graph = fresh(modes=3, nominal=(0.95, 0.9), sizes=[50.0, 30.0, 20.0])
    ceiling, pace = np.array([[0.6, 0.9, 0.1], [0.8, 0.3, 0.9], [0.05, 0.05, 0.05]]), 0.5
    rule = make_chooser("lookahead", {"c_learn": c_learn, "trust": 1000.0})
    *_, history = learn(graph, rule, saturates(ceiling, pace), rounds=200, rng=np.random.default_rng(0))
    assert 0 < len(history) < 200, "nothing is worth its cost for ever"
    count = history.counts
    best = graph.with_q(history.best)
    now = float(value_of_failures(best))
    trained = count > 0
    following = np.where(trained, ceiling * (1.0 - pace ** (count + 1)), history.best)
    assert predicted_value(best, following).max() - now <= c_learn + 0.02, (
        "of what it knows, no query was left that pays"
    )
    free = make_chooser("lookahead")
    *_, on = learn(graph, free, saturates(ceiling, pace), rounds=30, rng=np.random.default_rng(0))
    assert len(on) == 30, "without a cost it uses its budget"


def test_dear_queries_are_left_for_cheap_ones():
    graph = fresh(modes=2, nominal=(0.9,), sizes=[10.0, 10.0])
    costs = [[1.0, 1.0], [40.0, 40.0]]
    *_, history = learn(
        graph,
        make_chooser("lookahead", {"costs": costs}),
        saturates(np.full((2, 2), 0.8), 0.8),
        rounds=6,
        rng=np.random.default_rng(0),
    )
    assert history.counts[1].sum() == 0


@pytest.mark.parametrize(
    ("params", "message"),
    [
        ({"horizon": 0}, r"lookahead: horizon: 0 given"),
        ({"c_learn": -1.0}, r"lookahead: c_learn: -1.0 given"),
        ({"trust": 0}, r"lookahead: trust: 0 given"),
        ({"share_rest": -0.1}, r"lookahead: share_rest"),
        ({"costs": [[0.0, 1.0]]}, r"costs must be above 0"),
    ],
)
def test_settings_that_make_no_sense_are_refused(params, message):
    with pytest.raises(ConfigError, match=message):
        make_chooser("lookahead", params)


def test_costs_of_another_graph_are_refused():
    graph = fresh(modes=2, nominal=(0.9,))
    rule = make_chooser("lookahead", {"costs": [[1.0, 1.0]]})
    with pytest.raises(ConfigError, match=r"costs of \(1, 2\) recoveries given; the graph has \(2, 2\)"):
        rule(graph, History(graph.q), np.random.default_rng(0))


def test_trends_prefer_what_still_rises_and_is_worth_more():
    """By hand: one recovery has reached its ceiling, the other still rises by 0.1 a round; both are worth as much."""
    graph = fresh(modes=2, nominal=(0.9,), sizes=[10.0, 10.0])
    outcomes = [(mode, 1, q) for n in range(4) for mode, q in ((0, 0.5), (1, 0.1 * (n + 1)))]
    outcomes += [(mode, 0, None) for mode in (0, 1) for _ in range(4)]
    history = history_of(graph, outcomes)
    now = graph.with_q(history.best)
    choice = make_chooser("rising", {"exploration": 0.0, "ahead": 3})(now, history, np.random.default_rng(0))
    assert (choice.mode, choice.target) == (1, 1)
    expected = make_chooser("extrapolation")(now, history, np.random.default_rng(0))
    assert (expected.mode, expected.target) == (1, 1)


@pytest.mark.parametrize("params", [{"window": 0.0}, {"window": 0.6}, {"exploration": -1.0}, {"ahead": 0}])
def test_settings_of_a_trend_are_checked(params):
    with pytest.raises(ConfigError, match=f"rising: {next(iter(params))}"):
        make_chooser("rising", params)

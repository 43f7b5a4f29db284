from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from p2l.errors import ConfigError, ShapeError
from p2l.metareskill.choosers.oracle import best_plan, best_values, regret
from p2l.metareskill.choosers.table import CHOOSERS, make_chooser
from p2l.metareskill.history import hopeless
from p2l.metareskill.improvement import improvement
from p2l.metareskill.value_iteration import predicted_value, value_of_failures
from tests.metareskill.skill_graphs import fresh, graphs, run, saturating, written

CONF = Path(__file__).parents[2] / "conf" / "chooser"
GRAPH = fresh()
CURVES = saturating(np.random.default_rng(7), GRAPH, 60)


def params(name, rounds):
    """As the YAML says, with what the oracle alone needs."""
    settings = yaml.safe_load((CONF / f"{name}.yaml").read_text())["params"]
    return {**settings, "curves": CURVES, "budget": rounds} if name == "oracle" else settings


def test_every_chooser_has_its_file():
    assert {path.stem for path in CONF.glob("*.yaml")} == set(CHOOSERS.names())
    assert all(yaml.safe_load(path.read_text())["name"] == path.stem for path in CONF.glob("*.yaml"))


@pytest.mark.parametrize("name", CHOOSERS.names())
def test_a_chooser_repeats_itself_and_never_beats_the_oracle(name):
    first, second = (run(GRAPH, name, CURVES, 50, **params(name, 50)) for _ in range(2))
    assert [(each.mode, each.target) for each in first.rounds] == [(each.mode, each.target) for each in second.rounds]
    assert regret(GRAPH, first, CURVES).min() >= -1e-9
    assert first.values[-1] == pytest.approx(value_of_failures(GRAPH, first.best))
    assert (np.diff(first.values) >= -1e-12).all()


@pytest.mark.parametrize("name", ["metareskill", "ucb1", "thompson"])
def test_initial_rounds_come_first_and_in_turn(name):
    history = run(GRAPH, name, CURVES, 41, **params(name, 41))
    np.testing.assert_array_equal(history.pairs[:40], np.tile(np.arange(20), 2))
    assert {each.reason for each in history.rounds[:40]} == {"initial round"}
    assert history.rounds[40].reason != "initial round"


def test_round_robin_takes_turns():
    np.testing.assert_array_equal(run(GRAPH, "round_robin", CURVES, 60).counts, 3)


@given(st.lists(st.integers(1, 400), min_size=1, max_size=6), st.integers(1, 60))
def test_weighted_round_robin_is_proportional(sizes, rounds):
    graph = fresh(sizes=sizes)
    trained = run(graph, "weighted_round_robin", np.zeros((*graph.q.shape, 60)), rounds).counts
    assert np.abs(trained.sum(axis=1) - rounds * graph.share).max() < max(1.0, len(sizes) / 2)
    assert (np.ptp(trained, axis=1) <= 1).all()


def test_metareskill_takes_the_highest_prediction_and_says_so():
    history = run(GRAPH, "metareskill", CURVES, 55, **params("metareskill", 55))
    last = history.rounds[-1]
    past = written(GRAPH, [((each.mode, each.target), each.q) for each in history.rounds[:-1]])
    q_upper = improvement(past, window=3, confidence=0.95).q_upper
    predicted = predicted_value(GRAPH.with_q(past.best), q_upper)
    assert predicted[last.mode, last.target] == last.predicted >= predicted.max() - 1e-3
    assert q_upper[last.mode, last.target] == last.q_upper


def test_metareskill_goes_on_where_every_recovery_is_infeasible():
    history = run(GRAPH, "metareskill", np.zeros((5, 4, 60)), 60, initial_rounds=2)
    assert (history.values == -10.0).all()
    np.testing.assert_array_equal(hopeless(history), np.arange(5))
    assert len(np.unique(history.pairs[40:])) > 5  # all predictions tie, so the rounds are spread at random


def test_a_mode_with_an_untried_or_working_recovery_is_not_hopeless():
    curves = np.zeros((5, 4, 60))
    curves[1, 2] = 0.5
    np.testing.assert_array_equal(hopeless(run(GRAPH, "round_robin", curves, 20)), [0, 2, 3, 4])
    np.testing.assert_array_equal(hopeless(run(GRAPH, "round_robin", curves, 3)), [])


def test_bandits_prefer_what_paid():
    """Only (0, 3) ever improves, and in every round."""
    curves = np.zeros((5, 4, 80))
    curves[0, 3] = np.minimum(1.0, np.arange(1, 81) / 20)
    for name in ("ucb1", "thompson"):
        trained = run(GRAPH, name, curves, 80, **params(name, 80)).counts
        assert trained[0, 3] > 2 * np.delete(trained.ravel(), 3).max()


@given(graphs(max_nominal=2, max_modes=3), st.integers(0, 2**32 - 1), st.integers(1, 6))
def test_the_best_plan_is_the_best_of_all_allocations(graph, seed, budget):
    curves = np.random.default_rng(seed).random((*graph.q.shape, 4))
    best = np.maximum.accumulate(np.concatenate([graph.q[..., None], curves], axis=2), axis=2)

    def reached(plan):
        return value_of_failures(graph, np.take_along_axis(best, np.minimum(plan, 4)[..., None], 2)[..., 0])

    values, plan = best_values(graph, curves, budget), best_plan(graph, curves, budget)
    assert plan.sum() <= budget
    assert reached(plan) == pytest.approx(values[-1], abs=1e-9)
    assert (np.diff(values) >= -1e-12).all()
    for _ in range(20):
        pairs = np.random.default_rng(seed).integers(0, plan.size, budget)
        other = np.bincount(pairs, minlength=plan.size).reshape(plan.shape)
        assert reached(other) <= values[-1] + 1e-9


@given(st.integers(0, 2**32 - 1), st.integers(1, 30))
def test_the_oracle_has_no_regret(seed, budget):
    graph = fresh(3)
    curves = saturating(np.random.default_rng(seed), graph, 30)
    history = run(graph, "oracle", curves, budget, curves=curves, budget=budget)
    assert regret(graph, history, curves)[-1] == pytest.approx(0.0, abs=1e-9)


def test_metareskill_needs_less_budget_than_round_robin():
    """Paired over seeds: a better final value, and round-robin's best sooner."""
    ahead, share = [], []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        graph = fresh(sizes=rng.integers(50, 600, 5))
        curves = saturating(rng, graph, 100)
        ours = run(graph, "metareskill", curves, 100, seed, **params("metareskill", 100)).values
        theirs = run(graph, "round_robin", curves, 100, seed).values
        ahead.append(ours[-1] > theirs[-1])
        share.append(1.0 if ours[-1] < theirs[-1] else (np.argmax(ours >= theirs[-1]) + 1) / 100)
    assert np.mean(ahead) >= 0.8
    assert np.mean(share) <= 0.8


def test_unknown_choosers_and_settings_are_refused():
    with pytest.raises(
        ConfigError, match="unknown chooser 'greedy'; known: extrapolation, lookahead, metareskill, oracle"
    ):
        make_chooser("greedy")
    with pytest.raises(ConfigError, match=r"unknown parameters \['alpha'\]; allowed: initial_rounds, .*confidence"):
        make_chooser("metareskill", {"alpha": 0.9})
    with pytest.raises(ConfigError, match="already registered"):
        CHOOSERS.register("ucb1", "p2l.metareskill.choosers.rules:round_robin")
    with pytest.raises(ConfigError, match="is no target"):
        CHOOSERS.register("new", "p2l")


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("metareskill", {"window": 1}),
        ("metareskill", {"window": 2.5}),
        ("metareskill", {"confidence": 1.0}),
        ("metareskill", {"confidence": "0.95"}),
        ("metareskill", {"tie": float("nan")}),
        ("metareskill", {"initial_rounds": -1}),
        ("ucb1", {"exploration": -0.1}),
        ("thompson", {"prior": 0}),
        ("oracle", {}),
        ("oracle", {"curves": CURVES, "budget": 0}),
    ],
)
def test_settings_out_of_range_are_refused_before_any_training(name, settings):
    with pytest.raises(ConfigError, match=r" given; | must be "):
        make_chooser(name, settings)


def test_curves_of_another_graph_are_refused():
    with pytest.raises(ShapeError, match="curves: axis 0"):
        best_values(fresh(3), CURVES, 5)

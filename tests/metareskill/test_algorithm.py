import dataclasses
import json

import numpy as np
import pytest

from p2l.artifacts import load_arrays, save_arrays
from p2l.errors import ConfigError, ShapeError
from p2l.metareskill.algorithm import learn
from p2l.metareskill.choosers.table import make_chooser
from p2l.metareskill.history import History, Trained, table
from tests.metareskill.skill_graphs import fresh, replayed, run, saturating, written

GRAPH = fresh(3)
CURVES = saturating(np.random.default_rng(3), GRAPH, 80)
SETTINGS = {"initial_rounds": 2}


def steps(chooser, rounds, *, seed=0, **more):
    rng = np.random.Generator(np.random.PCG64(seed))
    return learn(GRAPH, make_chooser(chooser, SETTINGS), replayed(CURVES), rounds=rounds, rng=rng, **more)


def same(one, other):
    first, second = one.arrays(), other.arrays()
    assert first.keys() == second.keys()
    for name in first:
        np.testing.assert_array_equal(first[name], second[name])


@pytest.mark.parametrize("chooser", ["metareskill", "thompson"])
@pytest.mark.parametrize("cut", [1, 24, 37])
def test_an_interrupted_loop_resumes_to_the_bit(chooser, cut, tmp_path):
    *_, whole = steps(chooser, 45)
    for history in steps(chooser, 45):
        if len(history) == cut:
            save_arrays(tmp_path / "history.npz", history.arrays(), schema="history", version=1)
            break
    stored = History.from_arrays(load_arrays(tmp_path / "history.npz", schema="history", version=1))
    *_, resumed = steps(chooser, 45, seed=99, history=stored)
    same(resumed, whole)


def test_a_history_without_rounds_survives_storage_and_a_finished_one_yields_nothing(tmp_path):
    save_arrays(tmp_path / "history.npz", History(GRAPH.q).arrays(), schema="history", version=1)
    same(History.from_arrays(load_arrays(tmp_path / "history.npz", schema="history", version=1)), History(GRAPH.q))
    *_, whole = steps("metareskill", 30)
    assert list(steps("metareskill", 30, history=whole)) == []


def test_the_trainer_learns_how_often_it_was_asked():
    asked = []

    def train(mode, target, attempt):
        asked.append((mode, target, attempt))
        return Trained(0.1 * attempt)

    *_, last = learn(
        fresh(1, nominal=(0.9,)), make_chooser("round_robin"), train, rounds=4, episodes=2, rng=np.random.default_rng(0)
    )
    assert asked == [(0, j, 2 * turn + e) for turn in (0, 1) for j in (0, 1) for e in (0, 1)]
    np.testing.assert_allclose(last.best, [[0.3, 0.3]])
    assert len(last) == 4


def test_rounds_are_explained():
    rows = table(run(GRAPH, "metareskill", CURVES, 30, initial_rounds=2), ["grasp", "rotate", "pull", "goal"])
    assert [row["round"] for row in rows] == list(range(1, 31))
    last = rows[-1]
    assert last["target_name"] == ["grasp", "rotate", "pull", "goal"][last["target"]]
    assert last["q_after"] == max(last["q"], last["q_before"])
    assert last["q_before"] <= last["q_upper"] <= 1.0
    assert last["predicted"] >= rows[-2]["value"] - 1e-9
    assert np.isnan(rows[0]["predicted"])
    assert rows[0]["reason"] == "initial round"


def test_a_failed_query_is_kept_as_a_failure():
    *_, last = learn(
        GRAPH,
        make_chooser("round_robin"),
        lambda *_: Trained(0.0, trials=20, solved=False),
        rounds=3,
        rng=np.random.default_rng(0),
    )
    assert [(each.solved, each.q, each.trials) for each in last.rounds] == [(False, 0.0, 20)] * 3


def test_recoveries_that_are_known_already_count_as_the_start():
    graph = GRAPH.with_q(np.full(GRAPH.q.shape, 0.4))
    last = run(graph, "round_robin", np.full((3, 4, 5), 0.3), 12)
    np.testing.assert_array_equal(last.best, graph.q)
    np.testing.assert_array_equal(last.last_differences(3)[..., 0], 0.0)


def test_the_last_differences_are_the_newest_first():
    history = written(GRAPH, [((1, 2), 0.1), ((0, 0), 0.5), ((1, 2), 0.4), ((1, 2), 0.2), ((1, 2), 0.9)])
    np.testing.assert_allclose(history.last_differences(3)[1, 2], [0.5, 0.0, 0.3])
    np.testing.assert_allclose(history.last_differences(3)[0, 0], [0.5, np.nan, np.nan])
    assert np.isnan(history.last_differences(3)[2]).all()


def test_bad_requests_are_refused_before_any_training():
    with pytest.raises(ConfigError, match=r"23 rounds .* at least 24 rounds"):
        steps("metareskill", 23)
    with pytest.raises(ConfigError, match="of 0 trainings"):
        steps("metareskill", 30, episodes=0)
    with pytest.raises(ConfigError, match="other recoveries"):
        steps("metareskill", 30, history=History(np.zeros((3, 5))))
    chooser, rng = make_chooser("round_robin"), np.random.Generator(np.random.MT19937(0))
    with pytest.raises(ConfigError, match="PCG64, got MT19937"):
        learn(GRAPH, chooser, replayed(CURVES), rounds=3, rng=rng)
    with pytest.raises(ShapeError, match=r"q = 1\.5"):
        Trained(1.5)


def test_a_damaged_history_is_refused():
    *_, history = steps("metareskill", 30)
    assert json.loads(history.generator)["bit_generator"] == "PCG64"
    with pytest.raises(ShapeError, match="round 1: recovery"):
        dataclasses.replace(history, rounds=(dataclasses.replace(history.rounds[0], q_before=0.5),))
    with pytest.raises(ShapeError, match="is none of the 3 × 4"):
        dataclasses.replace(history, rounds=(dataclasses.replace(history.rounds[0], mode=3),))

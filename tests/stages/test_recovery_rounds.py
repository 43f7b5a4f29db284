"""The stage iterate_recoveries on the small push world: a second round learns from what the first one left."""

import dataclasses

import numpy as np
import pandas as pd
import pytest

from p2l.errors import ConfigError
from p2l.failures.classifier import ModeClassifier, load_modes
from p2l.failures.record import load_failures
from p2l.metareskill.failure_rounds.growth import join
from p2l.metareskill.record import load_recoveries
from p2l.preconditions.record import load_preconditions
from stages import iterate_recoveries
from tests.stages import recovering

recovering.STAGES["iterate_recoveries"] = iterate_recoveries


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("prepared")
    recovering.prepare(made)
    return made


# Absolute poses from few solved queries: recoveries that leave something to learn.
LEARN = {"guesses": [], "rounds": 12, "query": {"updates": 1, "rollouts": 4, "solved": 0.25}}


def iterate(folder, out, **changes):
    budget = {"max_modes": 2, "executions": {"train": 180, "held_out": 120}, "development": 12, "max_options": 4}
    recovering.run("iterate_recoveries", out, **{**recovering.found(folder), **LEARN, **budget, **changes})


def test_a_second_round_goes_on_from_the_first(folder, tmp_path):
    out = tmp_path / "out"
    iterate(folder, out)
    table = pd.read_csv(out / "success.csv")
    mine = table[table["seed"] == "0"].set_index("round")
    assert mine.index.tolist() == [0, 1, 2]
    assert mine["queries"].tolist() == [0, 12, 24]
    assert mine.loc[1, "modes"] == 2 < mine.loc[2, "modes"]
    assert ((table["low"] <= table["success"]) & (table["success"] <= table["high"])).all()
    assert table[table["seed"] == "all"]["success"].tolist() == mine["success"].tolist()
    assert (out / "success.png").stat().st_size > 10_000

    world = recovering.PushSeen()
    fitted = load_preconditions(recovering.found(folder)["preconditions"], world)
    rounds = [out / "s0" / f"round_{number}" for number in (1, 2)]
    modes = [load_modes(each / "modes.npz", world) for each in rounds]
    first, second = (
        load_recoveries(each / "recoveries.npz", world, fitted, one) for each, one in zip(rounds, modes, strict=True)
    )
    assert (second.graph.q[:2] >= first.graph.q).all()
    failures = load_failures(rounds[0] / "failures_train.npz", "train")
    assert len(failures) == mine.loc[2, "found"] == second.graph.sizes[2:].sum()
    assert set(failures.option_names()) == {"recovery"}

    before = {path: path.stat().st_mtime_ns for path in out.glob("**/ledger.npz")}
    assert len(before) == 2
    iterate(folder, out)  # as after a kill: nothing is asked again
    assert before == {path: path.stat().st_mtime_ns for path in out.glob("**/ledger.npz")}
    pd.testing.assert_frame_equal(pd.read_csv(out / "success.csv"), table)


def test_the_first_round_asks_nothing_that_learn_recoveries_has_asked(folder, tmp_path):
    records = str(tmp_path / "records")
    recovering.learn(folder, tmp_path / "learn", **LEARN, compare=["metareskill"], records=records)
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "records").iterdir()}
    iterate(folder, tmp_path / "out", failure_rounds=1, development=2, records=records)
    assert before == {path: path.stat().st_mtime_ns for path in (tmp_path / "records").iterdir()}
    assert not list((tmp_path / "out").glob("**/ledger.npz"))
    learnt = [np.load(tmp_path / name) for name in ("learn/recoveries/s0.npz", "out/s0/round_1/recoveries.npz")]
    np.testing.assert_array_equal(*(one["graph.q"] for one in learnt))


def test_a_budget_that_would_not_cover_new_modes_is_refused_at_once(folder, tmp_path):
    with pytest.raises(ConfigError, match=r"24 rounds .* needs at least 36 rounds"):
        iterate(folder, tmp_path, max_modes=4)
    assert not list(tmp_path.iterdir())


def test_two_classifiers_in_one_by_hand():
    """Weights as 30 to 10 failures; the second one's mean 1 · 2 + 5 = 7 is (7 − 1) / 3 = 2 in the first's units."""
    make = ModeClassifier("push", "", "pessimistic", ("a",), ("a",), *map(np.array, ([1.0], [3.0], [1.0], [[0.0]],
        [[[1.0]]], [30])))  # fmt: skip
    other = dataclasses.replace(
        make, centre=np.array([5.0]), spread=np.array([2.0]), means=np.array([[1.0]]), sizes=np.array([10])
    )
    both = join(make, other)
    np.testing.assert_allclose(both.weights, [0.75, 0.25])
    np.testing.assert_allclose(both.means, [[0.0], [2.0]])
    np.testing.assert_allclose(both.covariances, [[[1.0]], [[4.0 / 9.0]]])
    assert both.sizes.tolist() == [30, 10]

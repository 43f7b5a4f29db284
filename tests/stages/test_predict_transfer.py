"""The stage from a person's files to a transfer table, at smoke size; and the example of the shop."""

import csv
import importlib
import json
from pathlib import Path

import numpy as np
import pytest

from examples.shop import make
from p2l.team.trial_files import read_features, read_orders, read_trials

SHOP = Path(make.__file__).parent
FEATURES, TRIALS, ORDERS = (SHOP / f"{name}.csv" for name in ("features", "trials", "orders"))
SMALL = ("models=[logistic]", "folds=3", "members=5", "next_trials=2")


@pytest.fixture
def stage(tmp_path, monkeypatch, capsys):
    """Run the stage; gives exit code, output folder, and what it printed."""

    def run(*words):
        monkeypatch.setenv("HYDRA_FULL_ERROR", "1")
        out = tmp_path / "out"
        monkeypatch.setattr(
            "sys.argv", ["predict_transfer", *SMALL, *words, "tracking=disabled", f"hydra.run.dir={out}"]
        )
        with pytest.raises(SystemExit) as left:
            importlib.import_module("stages.predict_transfer").run()
        return left.value.code, out, capsys.readouterr()

    return run


def table(path):
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def test_a_table_a_figure_a_summary_and_the_next_trials_come_out(stage, tmp_path):
    mine = tmp_path / "transfer.csv"
    code, out, told = stage(f"features={FEATURES}", f"trials={TRIALS}", f"orders={ORDERS}", f"out={mine}")
    assert code == 0, told.err
    assert mine.read_bytes() == (out / "transfer.csv").read_bytes()
    rows = table(mine)
    assert len(rows) == 28 * 28
    assert sum(int(row["trials"]) for row in rows) == sum(int(row["attempts"]) for row in table(TRIALS))
    assert all(0.0 < float(row["low"]) < float(row["p"]) < float(row["high"]) < 1.0 for row in rows)
    tried = next(row for row in rows if int(row["trials"]))
    own = f"{tried['taught']}>{tried['tested']}:{tried['successes']}/{tried['trials']}"
    assert tried["supported_by"].split("; ")[0] == own
    summary = json.loads((out / "summary.json").read_text())
    summary = summary.get("content", summary)
    assert {score["model"] for score in summary["scores"]} == {"rates", "logistic"}
    trials = table(out / "next_trials.csv")
    assert 0 < len(trials) <= 2
    assert all(float(row["best_value"]) > 0.0 for row in trials)
    assert (out / "transfer.png").read_bytes()[:4] == b"\x89PNG"
    assert "log loss on held-out tasks" in told.out
    assert "784 pairs predicted" in told.out
    assert f"best next trial: {trials[0]['taught']} on {trials[0]['tested']}" in told.out


def test_families_alone_give_a_first_table(stage):
    code, out, told = stage(f"features={FEATURES}", "prior.same_family=0.7", "format=square")
    assert code == 0, told.err
    square = {row["task"]: row for row in table(out / "transfer.csv")}
    assert [square["peg_1"][name] for name in ("peg_1", "peg_2", "gear_1")] == ["0.900000", "0.700000", "0.100000"]
    assert "no trials: the stated prior alone" in told.out
    assert not (out / "next_trials.csv").exists()


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (("features=nowhere.csv",), ("nowhere.csv",)),
        ((f"features={TRIALS}",), ("column 'task'",)),
        ((f"features={FEATURES}", f"trials={ORDERS}"), ("orders.csv", "taught")),
        ((f"features={FEATURES}", f"out={FEATURES}"), ("is an input",)),
        ((f"features={FEATURES}", "prior.other=0.8"), ("prior", "0.8", "the more alike")),
        ((f"features={FEATURES}", "level=1.0"), ("level",)),
        ((f"features={FEATURES}", "models=[oracle]"), ("models",)),
        ((f"features={FEATURES}", "members=1000000000"), ("members", "less than or equal to 1000")),
        ((f"features={FEATURES}", "folds=1001", "next_trials=10001"), ("folds: given", "next_trials: given")),
        (("features={bare}",), ("column 'family'", "without trials")),
    ],
)
def test_a_mistake_is_one_message_before_any_work(stage, tmp_path, words, parts):
    bare = tmp_path / "bare.csv"
    bare.write_text("task,mm\na,1\nb,2\n")
    code, out, told = stage(*(word.format(bare=bare) for word in words))
    assert code == 2
    assert "Traceback" not in told.err
    for part in parts:
        assert part in told.err
    assert not out.exists()


def test_the_shop_s_files_are_those_that_its_script_makes(tmp_path):
    p = make.main(tmp_path)
    for path in tmp_path.iterdir():
        assert path.read_bytes() == (SHOP / path.name).read_bytes()
    by_hand = {"answers.csv", "outcomes.csv", "prior.csv"}
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in SHOP.glob("*.csv")} - by_hand
    tasks = read_features(FEATURES)
    assert (len(tasks.names), len(set(tasks.family.tolist()))) == (28, 9)
    trials = read_trials(TRIALS, tasks.names, FEATURES)
    assert len(trials) == 60
    problem, place = read_orders(ORDERS, tasks.names, FEATURES, "fixed")
    assert problem.n > len(set(place.tolist())) == 25
    rate = trials.successes / trials.attempts
    assert np.corrcoef(rate, p[trials.taught, trials.tested])[0, 1] > 0.6

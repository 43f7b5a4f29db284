"""The stages fit_preconditions and learn_recoveries on a small push world: results, resumption, refusals."""

import json
import signal
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from mlflow import MlflowClient

from p2l.artifacts import load_arrays, load_json
from p2l.contracts.world import symbols_of
from p2l.errors import ArtifactError, ConfigError
from p2l.failures.classifier import load_modes, save_modes
from p2l.failures.lost import lost
from p2l.failures.record import load_failures, save_failures
from p2l.metareskill.record import load_recoveries
from p2l.preconditions.record import load_preconditions, save_preconditions
from tests import waiting
from tests.stages.recovering import ROOT, WORLD, PushSeen, found, learn, prepare

RESULTS = ("rounds.csv", "queries.csv", "figure_4_6.csv", "figure_4_7.csv", "choosers.csv")
KILL = """
import os, signal, sys
from pathlib import Path
from p2l.metareskill.ledger import Ledger
from tests.stages.recovering import ROOT, WORLD, PushSeen, found, learn, prepare

add = Ledger.add
def killed(self, key, entry):
    add(self, key, entry)
    if len(self.entries) == {after}:
        os.kill(os.getpid(), signal.SIGKILL)
Ledger.add = killed
learn(Path(sys.argv[1]), Path(sys.argv[2]), store=sys.argv[3])
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """What discover, cluster and fit_preconditions left."""
    made = tmp_path_factory.mktemp("prepared")
    prepare(made)
    return made


@pytest.fixture(scope="module")
def tracked(folder, tmp_path_factory):
    """An uninterrupted training by two choosers and two seeds, and its store."""
    out = tmp_path_factory.mktemp("learnt")
    store = f"sqlite:///{out / 'runs.db'}"
    small = {"width": 64, "height": 48, "max_frames": 3, "hold_s": 0.0, "samples": 0}
    learn(folder, out / "out", store=store, seeds=[0, 1], videos=True, video=small)
    return out / "out", store


def test_preconditions_are_judged_on_held_out_samples(folder):
    out = folder / "fit_preconditions"
    preconditions = load_preconditions(out / "preconditions.npz", PushSeen())
    assert preconditions.targets == ("align", "push", "goal")
    scores, curve = pd.read_csv(out / "scores.csv"), pd.read_csv(out / "accuracy.csv")
    accuracy = scores[scores["metric"] == "accuracy"].set_index("skill")
    assert ((accuracy["low"] <= accuracy["value"]) & (accuracy["value"] <= accuracy["high"])).all()
    samples = load_arrays(out / "samples.npz", schema="precondition_samples", version=1)
    for skill in preconditions.names:
        tests = samples[f"{skill}.held_out"]
        assert accuracy.loc[skill, "n"] == tests.sum()
        mine = curve[curve["skill"] == skill]
        assert mine["samples"].max() == (~tests).sum()
        whole = mine.loc[mine["samples"] == mine["samples"].max(), "accuracy"]
        assert abs(whole.mean() - accuracy.loc[skill, "value"]) < 0.1  # the last point is the fit that is kept
    assert (out / "preconditions.png").stat().st_size > 10_000
    assert load_json(out / "summary.json", schema="preconditions_summary", version=1)["samples"] <= 96


def test_learning_leaves_skills_rounds_and_figures(folder, tracked):
    out, _ = tracked
    rounds, values = pd.read_csv(out / "rounds.csv"), pd.read_csv(out / "figure_4_7.csv")
    assert rounds.groupby(["seed", "chooser"]).size().tolist() == [16] * 4
    guessed = values[values["queries"] == 0]["value"]
    assert guessed.nunique() == 1, "all begin with the same guesses"
    assert -10.0 <= guessed.iloc[0] < values["value"].max()
    seen = rounds.sort_values("round").groupby(["seed", "chooser"])["value"]
    assert seen.apply(lambda curve: curve.is_monotonic_increasing).all(), "the better skill is kept"
    before = rounds.groupby(["seed", "chooser", "mode", "target"]).cumcount()
    curves = rounds.assign(before=before).groupby(["seed", "mode", "target", "before"])["q"].nunique()
    assert (curves == 1).all()  # every chooser sees the same learning curves
    queries = pd.read_csv(out / "queries.csv")
    assert len(queries) == queries.groupby(["seed", "mode", "target", "number"]).ngroups >= 16
    share = queries.groupby("solved")["success"]
    assert share.min().get(True, 1.0) > share.max().get(False, 0.0)
    assert (queries["kl_nats"].dropna() > 0.0).all()
    world = PushSeen()
    files = found(folder)
    given = load_preconditions(files["preconditions"], world), load_modes(files["modes"], world)
    learnt = load_recoveries(out / "recoveries" / "s0.npz", world, *given)
    kept = pd.read_csv(out / "figure_4_6.csv").query("seed == 0 and chooser == 'metareskill'")
    np.testing.assert_allclose(learnt.graph.q.ravel(), kept["q"], atol=1e-5)
    for name in ("figure_4_6.png", "figure_4_7.png", "graphs/s0.png", "graphs/s1.png"):
        assert (out / name).stat().st_size > 10_000


def test_with_guesses_recoveries_work_before_they_are_trained_and_what_they_reach_is_tried(folder, tmp_path):
    settings = {"guesses": ["straight", "take"], "seeds": [0], "compare": ["lookahead"], "rounds": 3, "reported": 48}
    sought = {"updates": 2, "rollouts": 10, "solved": 0.5, "verify": True}
    learn(folder, tmp_path / "a", **settings, query=sought)
    values = pd.read_csv(tmp_path / "a" / "figure_4_7.csv")
    assert values["queries"].tolist() == [0, 1, 2, 3]
    assert values["value"].iloc[0] > -10.0
    record = json.loads((tmp_path / "a" / "records" / "push-start-s0-b0.json").read_text())["content"]
    assert {guess for row in record["guess"] for guess in row} <= {"straight", "take"}
    kept = pd.read_csv(tmp_path / "a" / "figure_4_6.csv")
    assert (kept["q"] >= np.ravel(record["q"]) - 1e-6).all(), "training never makes a recovery worse"
    world, files = PushSeen(), found(folder)
    given = load_preconditions(files["preconditions"], world), load_modes(files["modes"], world)
    learnt = load_recoveries(tmp_path / "a" / "recoveries" / "s0.npz", world, *given)
    assert set(learnt.skills) == {(int(i), int(j)) for i, j in np.argwhere(learnt.graph.q > 0.0)}
    assert {skill.guess for skill in learnt.skills.values()} <= {"straight", "take"}
    learn(folder, tmp_path / "b", **settings, query=sought, records=str(tmp_path / "a" / "records"))
    for name in RESULTS:
        assert (tmp_path / "b" / name).read_bytes() == (tmp_path / "a" / name).read_bytes(), "from the records alone"
    fewer = settings | {"rounds": 2, "records": str(tmp_path / "a" / "records")}
    learn(folder, tmp_path / "c", **fewer, query=sought)
    assert len(pd.read_csv(tmp_path / "c" / "queries.csv")) == 2, (
        "the ledger holds a third one, which nobody asked here"
    )


def test_each_mode_is_filmed_on_the_way_into_a_failure_and_out_of_it(tracked):
    folder = tracked[0] / "videos"
    index = load_json(folder / "videos.json", schema="videos", version=1)
    if index["skipped"]:
        pytest.skip(index["skipped"])
    told = {(one["mode"], one["moment"]): one for one in index["videos"]}
    assert {mode for mode, _ in told} == {0, 1}
    assert {path.name for path in folder.glob("*.mp4")} == {one["file"] for one in index["videos"]}
    for mode in (0, 1):
        assert told[mode, "before"]["told"] == "missed in push"
        assert told[mode, "after"]["told"].startswith(f"recovery_{mode}_")
    assert any(one["solved"] for key, one in told.items() if key[1] == "after")


def test_one_parent_run_has_the_seeds_as_children(tracked):
    _, store = tracked
    client = MlflowClient(tracking_uri=store)
    runs = client.search_runs([client.get_experiment_by_name("learn_recoveries").experiment_id])
    [parent] = [each for each in runs if "mlflow.parentRunId" not in each.data.tags]
    children = [each for each in runs if each is not parent]
    assert {each.data.tags["mlflow.parentRunId"] for each in children} == {parent.info.run_id}
    told = sorted((each.data.tags["seed"], each.data.tags["method"]) for each in children)
    assert told == [(seed, chooser) for seed in "01" for chooser in ("metareskill", "round_robin")]
    for each in children:
        assert len(client.get_metric_history(each.info.run_id, "value")) == 16
    assert parent.data.metrics["value/metareskill"] == pytest.approx(
        np.mean([each.data.metrics["value"] for each in children if each.data.tags["method"] == "metareskill"])
    )


def test_a_killed_training_goes_on_to_the_bit_in_the_same_runs(folder, tracked, tmp_path):
    whole, _ = tracked
    after = 17  # queries; the first chooser asks 16, the second what the first has not asked
    store = f"sqlite:///{tmp_path / 'runs.db'}"
    killed = [sys.executable, "-c", KILL.format(after=after), str(folder), str(tmp_path / "out"), store]
    done = waiting.run(killed, cwd=ROOT)
    assert done.returncode == -signal.SIGKILL, done.stderr
    client = MlflowClient(tracking_uri=store)
    experiment = client.get_experiment_by_name("learn_recoveries").experiment_id
    before = {each.info.run_id for each in client.search_runs([experiment])}
    [ledger] = (tmp_path / "out").glob("**/*ledger*s0.npz")
    kept = load_arrays(ledger, schema="recovery_ledger", version=2)["seconds"]
    assert len(kept) == after
    learn(folder, tmp_path / "out", store=store)
    again = load_arrays(ledger, schema="recovery_ledger", version=2)["seconds"]
    np.testing.assert_array_equal(again[:after], kept)  # wall times are new where a query is run again
    for name in RESULTS[:3]:
        mine, theirs = (pd.read_csv(out / name) for out in (tmp_path / "out", whole))
        theirs = theirs[theirs["seed"] == 0].reset_index(drop=True)
        pd.testing.assert_frame_equal(mine, theirs, check_dtype=False)  # a column of one seed may hold whole numbers
    arrays = [
        load_arrays(out / "recoveries" / "s0.npz", schema="recoveries", version=4) for out in (tmp_path / "out", whole)
    ]
    assert arrays[0].keys() == arrays[1].keys()
    for key, value in arrays[0].items():
        np.testing.assert_array_equal(value, arrays[1][key])
    runs = client.search_runs([experiment])
    assert before <= {each.info.run_id for each in runs}
    assert len(runs) == 3  # the parent and its two choosers, none of them twice
    assert {each.info.status for each in runs} == {"FINISHED"}


def test_what_belongs_to_another_world_is_refused(folder, tracked, tmp_path):
    out, world, files = tmp_path / "out", PushSeen(), found(folder)
    preconditions, modes = load_preconditions(files["preconditions"], world), load_modes(files["modes"], world)
    save_preconditions(tmp_path / "preconditions.npz", replace(preconditions, digest="another"))
    save_modes(tmp_path / "modes.npz", replace(modes, digest="another"))
    with pytest.raises(ArtifactError, match=r"preconditions of world 'push_seen'.*run `python -m stages\.fit_pre"):
        learn(folder, out, preconditions=str(tmp_path / "preconditions.npz"))
    with pytest.raises(ArtifactError, match=r"modes of world 'push_seen'.*run `python -m stages\.cluster` again"):
        learn(folder, out, modes=str(tmp_path / "modes.npz"))
    variant = WORLD | {"params": WORLD["params"] | {"sigma_m": 0.025}}
    with pytest.raises(ArtifactError, match=r"another variant of world 'push_seen' \(sigma_m = 0\.03, not 0\.025"):
        learn(folder, out, world=variant)
    assert not list(out.iterdir())
    others = {
        "preconditions": (world, replace(preconditions, threshold=0.6), modes),
        "modes": (world, preconditions, replace(modes, means=modes.means + 1.0)),
        "digest": (PushSeen(sigma_m=0.025), preconditions, modes),
    }
    for name, given in others.items():
        with pytest.raises(ArtifactError, match=f"learnt with another {name}; give the files"):
            load_recoveries(tracked[0] / "recoveries" / "s0.npz", *given)


def test_a_budget_below_the_initial_rounds_is_refused_whichever_chooser_needs_them(folder, tmp_path):
    for compare in (["metareskill", "round_robin"], ["round_robin", "metareskill"]):
        with pytest.raises(ConfigError, match="chooser 'metareskill' needs at least 12 rounds"):
            learn(folder, tmp_path, rounds=11, compare=compare)
    assert not list(tmp_path.glob("**/*.npz"))


def test_where_no_recovery_ever_succeeds_that_is_said_and_nothing_breaks(folder, tmp_path, caplog):
    """Preconditions two metres away, and motions of three control steps."""
    world, files = PushSeen(), found(folder)
    fitted, modes = load_preconditions(files["preconditions"], world), load_modes(files["modes"], world)
    away = [replace(each, positive=replace(each.positive, means=each.positive.means + 2.0)) for each in fitted.skills]
    far = replace(fitted, skills=tuple(away))
    save_preconditions(tmp_path / "preconditions.npz", far)
    timing = {"legs": [1, 1, 1], "settle": [0, 0, 0]}
    learn(folder, tmp_path, preconditions=str(tmp_path / "preconditions.npz"), timing=timing, rounds=12)
    rounds = pd.read_csv(tmp_path / "rounds.csv")
    assert (rounds["q"] == 0.0).all()
    assert (rounds["value"] == -10.0).all()
    told = [line for line in caplog.messages if "ever succeeded" in line]
    assert len(told) == 4
    assert told[0].startswith("Seed 0, metareskill: no recovery from mode 0 (")
    assert not load_recoveries(tmp_path / "recoveries" / "s0.npz", world, far, modes).skills


def test_modes_are_of_failures_where_no_learnt_precondition_holds(folder):
    files, world = found(folder), PushSeen()
    fitted = load_preconditions(files["preconditions"], world)
    labels = load_arrays(folder / "cluster" / "labels.npz", schema="failure_labels", version=1)
    for split, name in (("train", "failures"), ("held_out", "held_out")):
        failures = load_failures(files[name], split)
        left = lost(world, symbols_of(world), fitted, failures)
        assert 0 < len(left) < len(failures)
        np.testing.assert_array_equal(labels[f"{split}_index"], left)
    table = pd.read_csv(folder / "cluster" / "modes.csv")
    assert table["size"].sum() == len(labels["train_index"])
    place = [labels["train_index"].tolist().index(one) for one in table["typical"]]  # counted in the file of failures
    assert labels["train"][place].tolist() == table["mode"].tolist()


def test_a_mode_of_one_failure_is_learnt_and_one_without_held_out_failures_refused(folder, tmp_path):
    files, world = found(folder), PushSeen()
    train, held_out = (load_failures(files[name]) for name in ("failures", "held_out"))
    modes, fitted = load_modes(files["modes"], world), load_preconditions(files["preconditions"], world)
    train = train.take(lost(world, symbols_of(world), fitted, train))
    kept = np.flatnonzero(modes.classify(train.truth)[0] == 0)
    one = np.append(kept, np.setdiff1d(np.arange(len(train)), kept)[:1])
    save_failures(tmp_path / "train.npz", train.take(one))
    learn(folder, tmp_path / "out", failures=str(tmp_path / "train.npz"), compare=["round_robin"], rounds=12)
    assert load_json(tmp_path / "out" / "summary.json", schema="learn_summary", version=1)["sizes"][1] == 1.0

    save_failures(tmp_path / "tests.npz", held_out.take(modes.classify(held_out.truth)[0] == 0))
    with pytest.raises(ArtifactError, match=r"failure modes \[1\] have no held-out failure"):
        learn(folder, tmp_path / "none", held_out=str(tmp_path / "tests.npz"))
    assert not list((tmp_path / "none").iterdir())


def test_a_mode_without_failures_is_refused(folder, tmp_path):
    modes = load_modes(found(folder)["modes"], PushSeen())
    third = {
        "weights": np.array([0.4, 0.4, 0.2]),
        "means": np.vstack([modes.means, modes.means[:1] + 1e3]),
        "covariances": np.concatenate([modes.covariances, modes.covariances[:1]]),
        "sizes": np.append(modes.sizes, 1),
    }
    save_modes(tmp_path / "modes.npz", replace(modes, **third))
    with pytest.raises(ArtifactError, match=r"failure modes \[2\] have no failure to train from; cluster into fewer"):
        learn(folder, tmp_path / "out", modes=str(tmp_path / "modes.npz"), rounds=30)

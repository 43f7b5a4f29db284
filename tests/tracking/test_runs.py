"""Runs in a real sqlite store: what is sent arrives, a killed run is continued, concurrent first users do not crash."""

import json
import multiprocessing
import os
import signal
import subprocess

import pytest
from mlflow import MlflowClient

from p2l.errors import InputError
from p2l.tracking import RUN_FILE, RunCard, open_sweep, start
from p2l.tracking.about import flatten, provenance
from tests import waiting


def card(**changes):
    fields = {
        "stage": "collect",
        "world": "lego",
        "method": "algorithm1",
        "seed": 3,
        "config": {"draws": 4, "domain": {"name": "lego"}, "levels": [0, 2]},
        "config_hash": "abc",
        "command": "python -m stages.collect domain=lego seed=3",
    }
    return RunCard(**{**fields, **changes})


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return f"sqlite:///{tmp_path_factory.mktemp('store') / 'runs.db'}"


@pytest.fixture
def client(store):
    return MlflowClient(tracking_uri=store)


def test_a_finished_run_says_everything(store, client, tmp_path):
    (tmp_path / "figure.png").write_bytes(b"png")
    with start(card(), tmp_path, tmp_path, uri=store) as track:
        for step in range(1500):  # more than one batch
            track.metrics({"loss": 1 / (step + 1)}, step=step)
        track.metrics({"success": 0.75, "ratio": float("nan"), "bound": float("inf")})
        track.artifact(tmp_path / "figure.png", "figures")
        track.note("Skills need the walls.")
    run = client.get_run(track.run_id)
    assert run.info.status == "FINISHED"
    assert run.info.run_name == "lego-algorithm1-s3"
    assert client.get_experiment(run.info.experiment_id).name == "collect"
    assert run.data.metrics == {"loss": pytest.approx(1 / 1500), "success": 0.75}
    assert len(client.get_metric_history(track.run_id, "loss")) == 1500
    assert run.data.params == {"draws": "4", "domain.name": "lego", "levels": "[0, 2]"}
    tags = run.data.tags
    assert {tags[name] for name in ("stage", "world", "method", "seed", "config_hash")} == {
        "collect", "lego", "algorithm1", "3", "abc"
    }  # fmt: skip
    assert tags["not_finite"] == "bound, ratio"
    for part in ("python -m stages.collect domain=lego seed=3", "| success | 0.75 |", "Skills need the walls."):
        assert part in tags["mlflow.note.content"]
    assert [entry.path for entry in client.list_artifacts(track.run_id)] == ["config.yaml", "figures"]


def test_the_repository_is_named(store, client, tmp_path):
    root = next(parent for parent in __import__("pathlib").Path(__file__).parents if (parent / ".git").exists())
    with start(card(), tmp_path, root, uri=store) as track:
        pass
    tags = client.get_run(track.run_id).data.tags
    assert len(tags["git_commit"]) == 40
    assert tags["git_dirty"] in ("true", "false")


@pytest.mark.parametrize(("error", "status"), [(InputError, "FAILED"), (KeyboardInterrupt, "KILLED")])
def test_an_error_ends_the_run_and_goes_on(store, client, tmp_path, error, status):
    tracks = []

    def fail():
        with start(card(), tmp_path, tmp_path, uri=store) as track:
            tracks.append(track)
            track.metrics({"done": 0.5})
            raise error("row 3 is bad")

    with pytest.raises(error, match="row 3"):
        fail()
    run = client.get_run(tracks[0].run_id)
    assert (run.info.status, run.data.metrics) == (status, {"done": 0.5})
    assert "row 3 is bad" in run.data.tags["mlflow.note.content"]


def test_a_wrong_input_leaves_no_failed_run(store, client, tmp_path):
    """A mistyped command is no experiment."""

    def refuse():
        with start(card(stage="mistyped"), tmp_path, tmp_path, uri=store):
            raise InputError("orders.csv: no such file")

    with pytest.raises(InputError):
        refuse()
    [found] = [each for each in client.search_experiments() if each.name == "mistyped"]
    assert client.search_runs([found.experiment_id]) == []
    assert not (tmp_path / RUN_FILE).exists()


def test_a_user_without_a_name_is_a_number(store, client, tmp_path, monkeypatch):
    """`docker run -u 12345`: no entry for the user, and no variable that names one."""
    for name in ("LOGNAME", "USER", "LNAME", "USERNAME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("pwd.getpwuid", {}.__getitem__)
    with start(card(), tmp_path, tmp_path, uri=store) as track:
        pass
    assert client.get_run(track.run_id).data.tags["mlflow.user"] == str(os.getuid())


def run_and_die(store, out):
    with start(card(), out, out, uri=store):
        os.kill(os.getpid(), signal.SIGKILL)


def test_a_killed_run_is_continued_under_its_id(store, client, tmp_path):
    process = multiprocessing.get_context("spawn").Process(target=run_and_die, args=(store, tmp_path))
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    killed = json.loads((tmp_path / RUN_FILE).read_text())["run_id"]
    assert client.get_run(killed).info.status == "RUNNING"
    with start(card(), tmp_path, tmp_path, uri=store) as track:
        assert track.run_id == killed
    assert client.get_run(killed).info.status == "FINISHED"


def test_an_interrupted_run_is_continued_under_its_id(store, client, tmp_path):
    with pytest.raises(KeyboardInterrupt), start(card(), tmp_path, tmp_path, uri=store) as first:
        raise KeyboardInterrupt
    with start(card(), tmp_path, tmp_path, uri=store) as second:
        assert second.run_id == first.run_id
        assert client.get_run(first.run_id).info.status == "RUNNING"
    assert client.get_run(first.run_id).info.status == "FINISHED"


def test_another_configuration_or_a_finished_run_is_not_continued(store, tmp_path):
    with start(card(), tmp_path, tmp_path, uri=store) as first:
        pass
    with start(card(), tmp_path, tmp_path, uri=store) as second:
        assert second.run_id != first.run_id
        with start(card(config_hash="other"), tmp_path, tmp_path, uri=store) as third:
            assert third.run_id != second.run_id


@pytest.mark.parametrize("config_hash", ["abc", "other"])
def test_work_that_goes_on_is_one_run_whatever_its_end_and_settings(store, client, tmp_path, config_hash):
    """Each start of a day opened a run of its own, from step 0."""
    with start(card(), tmp_path, tmp_path, uri=store) as first:
        assert not first.has_past
        first.metrics({"cost": 4.0}, step=0)
    config = {"draws": 4 if config_hash == "abc" else 5}  # a param that no store lets change
    more = card(goes_on=True, config_hash=config_hash, config=config)
    with start(more, tmp_path, tmp_path, uri=store) as second:
        assert (second.run_id, second.has_past) == (first.run_id, True)
        second.metrics({"cost": 3.0}, step=1)
    run = client.get_run(first.run_id)
    assert (run.info.status, run.data.params["draws"]) == ("FINISHED", "4")
    assert [(each.step, each.value) for each in client.get_metric_history(first.run_id, "cost")] == [(0, 4.0), (1, 3.0)]
    with pytest.raises(InputError), start(more, tmp_path, tmp_path, uri=store):
        raise InputError("a wrong row, before anything was recorded")
    assert client.get_run(first.run_id).info.status == "FINISHED"
    assert (tmp_path / RUN_FILE).exists()


@pytest.mark.parametrize("content", ["", "{", "[]", '{"run_id": "none", "config_hash": "abc", "store": "x"}'])
def test_a_damaged_run_file_starts_a_new_run(store, tmp_path, content):
    (tmp_path / RUN_FILE).write_text(content)
    with start(card(), tmp_path, tmp_path, uri=store) as track:
        assert track.run_id


def test_jobs_are_children_of_their_sweep(store, client, tmp_path, monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", store)
    parent, close = open_sweep("collect", "sweep", "python -m stages.collect -m seed=0,1", tmp_path)
    with start(card(parent=parent), tmp_path, tmp_path) as track:
        pass
    close("FINISHED")
    assert client.get_run(track.run_id).data.tags["mlflow.parentRunId"] == parent
    assert client.get_run(parent).info.status == "FINISHED"
    assert "seed=0,1" in client.get_run(parent).data.tags["mlflow.note.content"]


@pytest.mark.parametrize("place", ["_describe", "write_text", "Outbox"])
def test_a_stop_while_the_run_is_begun_ends_it(store, client, tmp_path, monkeypatch, place):
    """A stage that was stopped in its first half second left its run RUNNING for ever."""

    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(f"p2l.tracking.runs.{place}", stopped)
    with pytest.raises(KeyboardInterrupt), start(card(stage=f"stopped{place}"), tmp_path, tmp_path, uri=store):
        pass
    [experiment] = [each for each in client.search_experiments() if each.name.endswith(f"stopped{place}")]
    [run] = client.search_runs([experiment.experiment_id])
    assert run.info.status == "KILLED"


def test_jobs_that_a_launcher_took_down_do_not_run_for_ever(store, client, tmp_path, monkeypatch):
    """After Ctrl-C in a joblib sweep the jobs stayed RUNNING."""
    monkeypatch.setenv("MLFLOW_TRACKING_URI", store)
    parent, close = open_sweep("collect", "stopped", "python -m stages.collect -m seed=0,1", tmp_path)
    with start(card(parent=parent), tmp_path / "done", tmp_path) as done:
        pass
    experiment = client.get_run(parent).info.experiment_id
    mine, other = (
        client.create_run(experiment, tags={"mlflow.parentRunId": name}).info.run_id for name in (parent, "another")
    )
    close("KILLED")
    status = {name: client.get_run(run).info.status for name, run in
              {"parent": parent, "done": done.run_id, "mine": mine, "other": other}.items()}  # fmt: skip
    assert status == {"parent": "KILLED", "done": "FINISHED", "mine": "KILLED", "other": "RUNNING"}


def touch(store, out, start_line):
    start_line.wait()
    with start(card(stage="fresh"), out, out, uri=store) as track:
        track.metrics({"x": 1.0})


def test_processes_that_touch_a_fresh_store_together_all_succeed(tmp_path):
    store = f"sqlite:///{tmp_path / 'fresh.db'}"
    context = multiprocessing.get_context("spawn")
    start_line = context.Barrier(8)
    folders = [tmp_path / str(index) for index in range(8)]
    jobs = [context.Process(target=touch, args=(store, folder, start_line)) for folder in folders]
    for job in jobs:
        job.start()
    for job in jobs:
        job.join()
    assert [job.exitcode for job in jobs] == [0] * 8
    client = MlflowClient(tracking_uri=store)
    [found] = [each for each in client.search_experiments() if each.name == "fresh"]
    assert [run.data.metrics for run in client.search_runs([found.experiment_id])] == [{"x": 1.0}] * 8


def test_a_store_that_breaks_during_the_run_does_not_take_the_work_with_it(store, tmp_path, caplog, monkeypatch):
    with start(card(), tmp_path, tmp_path, uri=store) as track:
        track.metrics({"x": 1.0})
        with monkeypatch.context() as broken:
            broken.setattr(type(track.client), "log_metrics", lambda *_: 1 / 0)
            track.flush()
            waiting.until(lambda: "does not take what it is sent" in caplog.text)
    assert MlflowClient(tracking_uri=store).get_run(track.run_id).data.metrics == {"x": 1.0}


def test_a_checkout_of_another_owner_is_told_once(monkeypatch, caplog, tmp_path):
    """Commit and dirty flag were missing without a word."""
    subprocess.run(["git", "init", "--quiet", tmp_path], check=True)
    monkeypatch.setenv("GIT_TEST_ASSUME_DIFFERENT_OWNER", "1")
    for _ in range(2):
        assert "git_commit" not in provenance(tmp_path)
    [record] = caplog.records
    assert f"safe.directory {tmp_path}" in record.getMessage()
    outside = tmp_path / "outside"
    outside.mkdir()
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path))
    monkeypatch.delenv("GIT_TEST_ASSUME_DIFFERENT_OWNER")
    assert "git_commit" not in provenance(outside)
    assert len(caplog.records) == 1


def test_nothing_is_written_when_tracking_is_off(tmp_path):
    with start(card(), tmp_path, tmp_path, enabled=False, uri="http://127.0.0.1:9") as track:
        track.metrics({"x": float("nan")})
        track.artifact("nowhere.png")
        track.note("text")
        track.flush()
    assert list(tmp_path.iterdir()) == []


def test_params_fit_the_limits_of_mlflow(store, client, tmp_path):
    config = {"long": "x" * 10_000, "k" * 300: 1, "k" * 299 + "z": 2, "empty": {}, "none": None, "text": "1"}
    flat = flatten(config)
    assert len(flat) == 6
    assert max(map(len, flat)) <= 250
    assert max(map(len, flat.values())) <= 6000
    config |= {f"p{index}": index for index in range(150)}  # more than one batch
    with start(card(config=config), tmp_path, tmp_path, uri=store) as track:
        pass
    assert client.get_run(track.run_id).data.params == flatten(config)

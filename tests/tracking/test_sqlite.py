"""What is written to a sqlite store without MLflow is what MLflow writes, to the row."""

import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest
from mlflow import MlflowClient

from p2l.tracking.client import MlflowStore
from p2l.tracking.sqlite import REVISION, SqliteStore
from p2l.tracking.store import connect

TABLES = {
    "experiments": "experiment_id, name, artifact_location, lifecycle_stage, workspace",
    "runs": "name, source_type, source_name, entry_point_name, user_id, status, end_time, source_version,"
    " lifecycle_stage, experiment_id, artifact_uri, run_uuid, deleted_time IS NULL",
    "metrics": "key, value, timestamp, step, is_nan, run_uuid",
    "latest_metrics": "key, value, timestamp, step, is_nan, run_uuid",
    "params": "key, value, run_uuid",
    "tags": "key, value, run_uuid",
}


@pytest.fixture(scope="module")
def empty(tmp_path_factory):
    """A store as MLflow makes one."""
    folder = tmp_path_factory.mktemp("empty")
    MlflowClient(tracking_uri=f"sqlite:///{folder / 'runs.db'}").search_experiments()
    return folder / "runs.db"


@pytest.fixture
def pair(empty, tmp_path):
    """The same empty store twice: as MLflow's client writes to it, and as we do."""
    stores = []
    for name in ("theirs", "ours"):
        (tmp_path / name).mkdir()
        stores.append(Path(shutil.copy(empty, tmp_path / name / "runs.db")))
    return MlflowStore(MlflowClient(tracking_uri=f"sqlite:///{stores[0]}")), SqliteStore(stores[1])


def content(folder, names):
    """Rows of all tables and the run's files, run ids as names and the folder as a word."""

    def plain(value):
        text = value if isinstance(value, str) else None
        for run_id, name in names.items():
            text = text and text.replace(run_id, name)
        return value if text is None else text.replace(str(folder), "FOLDER")

    with closing(sqlite3.connect(folder / "runs.db")) as store:
        rows = {
            table: sorted([tuple(map(plain, row)) for row in store.execute(f"SELECT {columns} FROM {table}")], key=repr)
            for table, columns in TABLES.items()
        }
    files = {plain(str(file)): file.read_bytes() for file in (folder / "artifacts").rglob("*") if file.is_file()}
    return rows, files


def attempt(call, *arguments):
    """What a call returns, or the code of what it refuses."""
    try:
        return call(*arguments)
    except Exception as error:
        return getattr(error, "error_code", type(error))


def a_day(store, folder):
    """Calls of every kind; the ids of the runs by name, and what the calls said."""
    names, told = {}, []
    place = (folder / "artifacts").as_uri()
    told.append(store.find_experiment("plan"))
    experiment = store.create_experiment("plan", place)
    told += [experiment, store.create_experiment("plan", place), store.find_experiment("plan")]
    for name, tags in (("one", {}), ("two", {"mlflow.user": "me", "mlflow.parentRunId": "one", "x": "ü"})):
        names[store.create_run(experiment, name, tags)] = name
    one, two = names
    store.log_config(one, {"seed": 0, "domain": {"name": "größe"}, "levels": [1, 2], "none": None})
    (folder / "figure.png").write_bytes(b"a picture")
    store.log_artifact(one, str(folder / "figure.png"), "figures/late")
    store.log_artifact(one, str(folder / "figure.png"))
    store.set_tags(one, {"a": "1", "b": "2" * 6000})
    store.set_tags(one, {"a": "3"})
    store.log_params(one, {"p": "1", "q": "null"})
    store.log_params(one, {"p": "1", "r": ""})
    store.log_metrics(one, [["loss", 1.0, 5, 0], ["loss", 0.5, 6, 2], ["loss", 0.7, 9, 1], ["loss", 0.5, 6, 2]])
    store.log_metrics(one, [["loss", 0.25, 7, 2], ["loss", 0.5, 6, 2], ["a/b c-d.e:f", 3, 1, -1]])
    store.log_metrics(one, [["loss", 0.2, 7, 2], ["x" * 250, 1e300, 1, 0]])
    for bad in ("", "no!", "a//b", "../a", "/a", ".", "x" * 251, "☃ ok?"):
        told.append((bad, attempt(store.log_metrics, one, [["good", 1.0, 0, 0], [bad, 1.0, 0, 0]])))
        told.append((bad, attempt(store.log_params, one, {"good": "1", bad: "1"})))
        told.append((bad, attempt(store.set_tags, one, {"good": "1", bad: "1"})))
    told.append(attempt(store.log_params, one, {"new": "1", "p": "2"}))
    told.append(attempt(store.log_artifact, one, str(folder / "nowhere.png")))
    told.append([names[each] for each in store.running_children(experiment, "one")])
    store.set_status(one, "FINISHED", 77)
    told.append(store.status(one))
    store.set_status(one, "RUNNING")
    told += [store.status(one), store.status(two)]
    store.set_status(two, "KILLED", 78)
    told.append(store.running_children(experiment, "one"))
    store.delete_run(two)
    told.append(store.status(two))
    for call, *arguments in (
        (store.log_metrics, [["m", 1.0, 0, 0]]), (store.set_tags, {"t": "1"}), (store.log_params, {"p": "1"}),
        (store.set_status, "FAILED", 1),
    ):  # fmt: skip
        told += [attempt(call, run, *arguments) for run in (two, "0" * 32)]
    told.append(attempt(store.status, "0" * 32))
    return names, told


def test_both_stores_hold_the_same_after_the_same_day(pair, tmp_path):
    days = []
    for store, name in zip(pair, ("theirs", "ours"), strict=True):
        folder = tmp_path / name
        names, told = a_day(store, folder)
        days.append((content(folder, names), told))
    (theirs, told_theirs), (ours, told_ours) = days
    assert told_ours == told_theirs
    assert ours[1] == theirs[1]
    assert ours[0] == theirs[0]


def test_the_pinned_mlflow_makes_the_tables_that_we_know(empty):
    """Where it does not, every run imports MLflow again, without a word."""
    with closing(sqlite3.connect(empty)) as store:
        assert store.execute("SELECT version_num FROM alembic_version").fetchall() == [(REVISION,)]


def test_a_run_in_a_store_that_is_there_does_without_mlflow(empty, tmp_path):
    shutil.copy(empty, tmp_path / "runs.db")
    code = (
        "import sys; from pathlib import Path; from p2l.tracking import RunCard, start\n"
        f"here = Path({str(tmp_path)!r}); card = RunCard('plan', 'w', 'm', 0, {{}}, 'hash', 'command')\n"
        "with start(card, here, here, uri=f'sqlite:///{here}/runs.db') as track:\n    track.metrics({'x': 1.0})\n"
        "print('mlflow' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
    client = MlflowClient(tracking_uri=f"sqlite:///{tmp_path / 'runs.db'}")
    [run] = client.search_runs([client.get_experiment_by_name("plan").experiment_id])
    assert (run.info.status, run.data.metrics) == ("FINISHED", {"x": 1.0})


@pytest.mark.parametrize("change", ["another revision", "workspaces"])
def test_a_store_that_is_not_as_we_know_it_is_left_to_mlflow(empty, tmp_path, monkeypatch, change):
    shutil.copy(empty, tmp_path / "runs.db")
    if change == "workspaces":
        monkeypatch.setenv("MLFLOW_WORKSPACE", "default")
    else:
        monkeypatch.setattr("p2l.tracking.store.REVISION", "0")
    assert isinstance(connect(tmp_path, f"sqlite:///{tmp_path / 'runs.db'}")[1], MlflowStore)

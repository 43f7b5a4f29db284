"""A store that cannot be used is named at once, with a way out."""

import multiprocessing
import os
import signal
import socket
import sqlite3
import time
from contextlib import closing

import pytest
from filelock import FileLock

from p2l.errors import TrackingError
from p2l.tracking.store import connect, experiment, safe_uri


def test_the_default_store_lies_in_the_repository(tmp_path, monkeypatch):
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    uri, _ = connect(tmp_path)
    assert uri == f"sqlite:///{tmp_path / 'mlflow.db'}"
    assert (tmp_path / "mlflow.db").is_file()


@pytest.mark.parametrize(
    ("uri", "words"),
    [
        ("http://127.0.0.1:9", "cannot be reached"),
        ("sqlite:////nowhere/at/all/runs.db", "no such folder /nowhere/at/all"),
        ("runs", "neither a database nor a server"),
        ("file:///runs", "neither a database nor a server"),
        ("https://[bad", "cannot be reached"),
        ("postgresql://user:secret@127.0.0.1:9/runs", "cannot be reached"),
    ],
)
def test_an_unusable_store_is_named_with_a_way_out(tmp_path, uri, words):
    with pytest.raises(TrackingError, match=words) as caught:
        connect(tmp_path, uri)
    message = str(caught.value)
    assert "tracking.enabled=false" in message
    assert "secret" not in message
    assert "\n" not in message


def test_a_file_that_is_no_database_is_refused(tmp_path):
    (tmp_path / "runs.db").write_text("orders,costs\n" * 100)
    with pytest.raises(TrackingError, match="not a database"):
        connect(tmp_path, f"sqlite:///{tmp_path / 'runs.db'}")


def test_a_folder_in_place_of_the_database_is_refused(tmp_path):
    (tmp_path / "runs.db").mkdir()
    with pytest.raises(TrackingError, match="cannot be written"):
        connect(tmp_path, f"sqlite:///{tmp_path / 'runs.db'}")


def test_a_server_that_never_answers_does_not_hold_the_stage_up(tmp_path):
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        before = time.monotonic()
        with pytest.raises(TrackingError, match="cannot be reached"):
            connect(tmp_path, f"http://127.0.0.1:{silent.getsockname()[1]}")
        assert time.monotonic() - before < 60  # MLflow's own patience is many minutes


def test_passwords_are_not_shown():
    assert safe_uri("postgresql://me:secret@host:5432/runs") == "postgresql://me:***@host:5432/runs"
    assert safe_uri("sqlite:///runs.db") == "sqlite:///runs.db"


@pytest.mark.parametrize("name", ["feature%2Fdoor", "robot work", "it's", "Größe 機械", "a?b#c"])
def test_a_checkout_may_have_any_name(tmp_path, monkeypatch, name):
    """SQLAlchemy reads %2F as a slash, and MLflow tried for 105 s."""
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    root = tmp_path / name
    root.mkdir()
    uri, client = connect(root)
    assert (root / "mlflow.db").is_file()
    run = client.create_run(experiment(client, uri, "test"), "one", {})
    client.log_config(run, {"x": 1})
    assert (root / "mlartifacts" / "test").is_dir()


def make_tables_until_killed(path):
    """Die while MLflow makes the tables."""
    from sqlalchemy import event
    from sqlalchemy.engine import Engine

    count = 0

    def killing(*_):
        nonlocal count
        count += 1
        if count == 40:
            os.kill(os.getpid(), signal.SIGKILL)

    event.listen(Engine, "before_cursor_execute", killing)
    connect(path.parent, f"sqlite:///{path}")


def test_a_store_whose_making_was_killed_is_made_by_the_next_run(tmp_path):
    """No later run could use it: duplicate column name."""
    path = tmp_path / "runs.db"
    process = multiprocessing.get_context("spawn").Process(target=make_tables_until_killed, args=(path,))
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    assert not path.exists()
    _, client = connect(tmp_path, f"sqlite:///{path}")
    assert client.find_experiment("Default") == ("0", True)


def test_nobody_waits_for_the_lock_of_a_store_that_is_there(tmp_path):
    uri = f"sqlite:///{tmp_path / 'runs.db'}"
    connect(tmp_path, uri)
    with FileLock(f"{tmp_path / 'runs.db'}.lock"):
        _, client = connect(tmp_path, uri)
    assert client.find_experiment("Default") == ("0", True)


def test_a_store_that_an_earlier_kill_left_half_made_says_what_to_do(tmp_path):
    """MLflow said "duplicate column name", and `mlflow db upgrade` failed, too."""
    with closing(sqlite3.connect(tmp_path / "mlflow.db")) as store:
        store.execute("CREATE TABLE experiments (experiment_id INTEGER)")
        store.commit()
    with pytest.raises(TrackingError, match=r"mlflow\.db: its tables are half made.*move the file away"):
        connect(tmp_path, f"sqlite:///{tmp_path / 'mlflow.db'}")

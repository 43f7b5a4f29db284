"""A store that cannot be used is named at once, with a way out."""

import socket
import time

import pytest

from p2l.errors import TrackingError
from p2l.tracking.store import connect, safe_uri


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
        ("file:///tmp/runs", "neither a database nor a server"),
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

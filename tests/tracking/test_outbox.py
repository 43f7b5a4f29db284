"""A store that goes away while a run works: the work goes on, and nothing that was measured is lost."""

import json
import os
import signal
import socket
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from mlflow import MlflowClient

from p2l.errors import TrackingError
from p2l.schema import SCHEMAS, resolve, validate
from p2l.tracking import RUN_FILE, RunCard, Tracker, start
from p2l.tracking import outbox as module
from p2l.tracking.outbox import FOLDER, LIMIT, Outbox
from stages._child import child
from tests import waiting

ROOT = Path(__file__).resolve().parents[2]

CARD = RunCard("plan", "lego", "auto", 0, {"x": 1}, "abc", "python -m stages.plan")


@pytest.fixture
def server(tmp_path):
    """Starts a real tracking server on the same port and the same database; stops what is left."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    processes = []

    def up():
        database, artifacts = tmp_path / "server.db", tmp_path / "artifacts"
        command = [sys.executable, "-m", "mlflow", "server", "--backend-store-uri", f"sqlite:///{database}"]
        command += [
            "--artifacts-destination",
            str(artifacts),
            "--host",
            "127.0.0.1",
            "--port",
            str(port),
            "--workers",
            "1",
        ]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        processes.append(subprocess.Popen(command, start_new_session=True, **quiet))
        waiting.until(lambda: is_up(port))
        return f"http://127.0.0.1:{port}"

    def down():
        process = processes.pop()
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()

    yield up, down
    while processes:
        down()


def is_up(port):
    """Whether the server answers; its port is open long before, and on a busy machine too long for a stage to wait."""
    asked = urllib.request.Request(
        f"http://127.0.0.1:{port}/api/2.0/mlflow/experiments/search",
        data=b'{"max_results": 1}',
        headers={"Content-Type": "application/json"},
    )
    try:
        with urllib.request.urlopen(asked, timeout=waiting.IDLE_S) as answer:
            return answer.status == 200
    except (OSError, ValueError):
        return False


def test_a_server_that_dies_slows_nothing_and_gets_everything_when_it_is_back(server, tmp_path, caplog):
    """One flush once blocked the work for four minutes, and what it held was lost with the run."""
    up, down = server
    uri, out = up(), tmp_path / "out"
    figure = tmp_path / "figure.png"
    figure.write_bytes(b"a picture")
    with start(CARD, out, tmp_path, uri=uri) as track:
        track.metrics({"before": 1.0})
        track.flush()
        waiting.until(lambda: not track.outbox._queue)
        down()
        for step in range(5000):
            track.metrics({"loss": float(step)}, step=step)
        track.flush()
        track.artifact(figure)
        waiting.until(lambda: list((tmp_path / FOLDER).glob("*.jsonl")))
    assert sum("does not take what it is sent" in record.message for record in caplog.records) == 1
    assert sum(record.levelname == "WARNING" for record in caplog.records) == 1, "a single warning"
    up()
    with start(CARD, tmp_path / "next", tmp_path, uri=uri):
        pass
    assert not list((tmp_path / FOLDER).iterdir())
    client = MlflowClient(tracking_uri=uri)
    run = client.get_run(json.loads((out / RUN_FILE).read_text())["run_id"])
    assert run.info.status == "FINISHED"
    assert run.data.metrics == {"before": 1.0, "loss": 4999.0}
    assert "abc" in run.data.tags["config_hash"]
    assert [each.path for each in client.list_artifacts(run.info.run_id) if each.path.endswith("png")] == ["figure.png"]


class Flaky:
    """A store that takes nothing until it is `well`."""

    def __init__(self):
        self.well, self.taken = False, []

    def log_metrics(self, run_id, rows):
        self._take(("metrics", run_id, [(name, value) for name, value, *_ in rows]))

    def set_tags(self, run_id, tags):
        [(key, value)] = tags.items()
        self._take(("tag", run_id, key, value))

    def set_status(self, run_id, status, end_time):
        self._take(("end", run_id, status, end_time))

    def _take(self, what):
        if not self.well:
            raise ConnectionError("nobody is there")
        self.taken.append(what)


@pytest.fixture
def hasty(monkeypatch):
    """Waits of milliseconds."""
    for name in ("_FIRST_WAIT_S", "_LONGEST_WAIT_S", "_PATIENCE_S"):
        monkeypatch.setattr(module, name, 0.01)


def rows(number):
    return [["x", float(number), 0, number]]


def test_entries_arrive_in_order_once_the_store_is_back(tmp_path, hasty):
    client = Flaky()
    box = Outbox(client, "run", "http://store", tmp_path / "place", tmp_path / "spare")
    for number in range(3):
        box.put("metrics", rows=rows(number))
    waiting.until(lambda: box._file is not None)
    box.put("end", status="FINISHED", end_time=7)
    assert len((tmp_path / "place" / "run.jsonl").read_text().splitlines()) == 5
    client.well = True
    box.close()
    assert [what[0] for what in client.taken] == ["metrics", "metrics", "metrics", "end"]
    assert client.taken[1] == ("metrics", "run", [("x", 1.0)])
    assert not list((tmp_path / "place").iterdir())


def test_what_is_left_is_sent_by_the_next_run_to_the_same_store_and_by_no_other(tmp_path, hasty):
    box = Outbox(Flaky(), "one", "http://store", tmp_path, tmp_path / "spare")
    box.put("tag", key="mlflow.note.content", value="what was found")
    box.close()
    [left] = tmp_path.glob("*.jsonl")
    left.write_text(left.read_text() + '{"kind": "tag", "key": "half')  # a process that was killed
    other, same = Flaky(), Flaky()
    other.well = same.well = True
    Outbox(other, "two", "http://elsewhere", tmp_path, tmp_path / "spare").close()
    assert other.taken == []
    Outbox(same, "three", "http://store", tmp_path, tmp_path / "spare").close()
    assert same.taken == [("tag", "one", "mlflow.note.content", "what was found")]
    assert not list(tmp_path.iterdir())


def test_an_outbox_in_use_belongs_to_its_run(tmp_path, hasty):
    first = Outbox(Flaky(), "one", "http://store", tmp_path, tmp_path / "spare")
    first.put("tag", key="a", value="b")
    waiting.until(lambda: first._file is not None)
    second = Flaky()
    second.well = True
    Outbox(second, "two", "http://store", tmp_path, tmp_path / "spare").close()
    assert second.taken == []
    first.close()


def test_the_queue_is_bounded_and_a_folder_that_cannot_be_written_has_a_spare(tmp_path, hasty, caplog):
    (tmp_path / "place").write_text("a file where the folder should be")
    client = Flaky()
    box = Outbox(client, "run", "http://store", tmp_path / "place", tmp_path / "spare")
    box.put("metrics", rows=rows(0))
    waiting.until(lambda: box._file is not None)
    assert box._file == tmp_path / "spare" / "run.jsonl"
    for number in range(1, LIMIT + 10):
        box.put("metrics", rows=rows(number))
    box.put("end", status="FINISHED", end_time=7)
    assert len(box._queue) == LIMIT + 1
    box.close()
    assert "10 batches of metrics of run run did not fit" in caplog.text


def test_putting_never_waits_for_a_store_that_hangs(tmp_path, hasty):
    class Hanging(Flaky):
        def log_metrics(self, run_id, rows):
            gate.wait()

    gate = module.threading.Event()
    box = Outbox(Hanging(), "run", "http://store", tmp_path, tmp_path)
    for number in range(100):
        box.put("metrics", rows=rows(number))
    assert len(box._queue) >= 99  # all of them were taken while the first one hung
    gate.set()
    box.close()
    assert not box._queue


def test_a_child_whose_server_has_gone_goes_untracked_and_its_work_goes_on(server, tmp_path, caplog):
    """`learn_recoveries` ended where its second chooser's run could not be opened."""
    up, down = server
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        plain = resolve(compose("collect", ["experiment=smoke", "domain=lego"]))
    cfg = validate({**plain, "tracking": {"enabled": True, "uri": up()}}, SCHEMAS["collect"], "test")
    with start(CARD, tmp_path, tmp_path, uri=cfg.tracking.uri) as parent:
        parent.metrics({"x": 1.0})
        down()
        with child(parent, cfg, "collect", "one", 0, tmp_path / "runs") as track:
            track.metrics({"y": 1.0})
    assert "one, seed 0: goes untracked" in caplog.text


def test_errors_of_the_work_in_a_child_are_its_own(tmp_path):
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        plain = resolve(compose("collect", ["experiment=smoke", "domain=lego"]))
    cfg = validate(plain, SCHEMAS["collect"], "test")
    with pytest.raises(TrackingError, match="mine"), child(Tracker(), cfg, "collect", "one", 0, tmp_path):
        raise TrackingError("mine")


def test_what_a_store_refuses_does_not_hold_up_what_comes_after(tmp_path, caplog):
    """The first entry of a deleted run would have been sent again by every later run, for ever."""
    uri = f"sqlite:///{tmp_path / 'runs.db'}"
    with start(CARD, tmp_path / "out", tmp_path, uri=uri) as track:
        track.outbox.put("metrics", rows=[["not: a ☃ name!", 1.0, 0, 0]])
        track.artifact(tmp_path / "nowhere.png")
        track.metrics({"x": 1.0})
    run = MlflowClient(tracking_uri=uri).get_run(track.run_id)
    assert (run.info.status, run.data.metrics) == ("FINISHED", {"x": 1.0})
    assert [record.message.split(" of run")[0] for record in caplog.records if "refuses" in record.message] == [
        "MLflow refuses the metrics", "MLflow refuses the artifact"
    ]  # fmt: skip
    assert not list((tmp_path / FOLDER).glob("*"))

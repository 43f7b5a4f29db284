"""What goes to MLflow waits in a queue, and a thread sends it: a store that is slow or gone does not slow the work.

While the store takes what it is sent, the queue lives in memory. From the first failure on, all that waits is also on
disk, in `.outbox/<run>.jsonl` of the repository (in the run's own folder where that cannot be written), and one warning
says so. The thread tries again, less and less often; what is left when a run ends is sent by the next run to the
same store. The queue is bounded: beyond `LIMIT` entries, metrics of single steps are dropped, and counted.
"""

from __future__ import annotations

import json
import logging
import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from p2l.artifacts import write_text
from p2l.errors import ArtifactError
from p2l.tracking.client import RunStore

log = logging.getLogger(__name__)
FOLDER = ".outbox"
LIMIT = 10_000  # entries; one holds up to a thousand metrics
_FIRST_WAIT_S, _LONGEST_WAIT_S = 1.0, 60.0
_PATIENCE_S = 10.0  # how long a run that is over waits for a store that takes nothing
# This queue is patient, so that a single attempt need not be.
IMPATIENCE = {"MLFLOW_HTTP_REQUEST_MAX_RETRIES": "0", "MLFLOW_HTTP_REQUEST_TIMEOUT": "20"}
# MLflow's codes of what asking again would not change; where nobody answers the code is another.
_REFUSALS = frozenset({"INVALID_PARAMETER_VALUE", "RESOURCE_DOES_NOT_EXIST", "BAD_REQUEST", "PERMISSION_DENIED"})
Entry = Mapping[str, Any]


class Outbox:
    """Sends the entries of one run, in order, from a thread of its own.

    Args:
        client: the store.
        run_id: the run.
        store: URI of the store, without a password.
        place: folder for what cannot be sent.
        spare: folder to use where `place` cannot be written.
    """

    def __init__(self, client: RunStore, run_id: str, store: str, place: Path, spare: Path) -> None:
        self._client, self._run_id, self._store = client, run_id, store
        self._place, self._spare = place, spare
        self._queue: deque[Entry] = deque()
        self._change = threading.Condition()
        self._file: Path | None = None
        self._lock: FileLock | None = None
        self._dropped = 0
        self._over_at_s: float | None = None  # on the monotonic clock
        self._has_given_up = False
        self._thread = threading.Thread(target=self._run, name="mlflow-outbox", daemon=True)
        self._thread.start()

    def put(self, kind: str, **content: Any) -> None:
        """Queue an entry: `metrics`, `artifact`, `tag` or `end`; returns at once."""
        entry = {"kind": kind, **content}
        with self._change:
            if len(self._queue) >= LIMIT and kind == "metrics":
                self._dropped += 1
                return
            self._queue.append(entry)
            if self._file is not None:
                self._append(entry)
            self._change.notify()

    def close(self) -> None:
        """Wait until all is sent, or until the store has taken nothing for a while; the rest stays on disk."""
        with self._change:
            self._over_at_s = time.monotonic()
            self._change.notify()
        self._thread.join()
        if self._dropped:
            log.warning("MLflow: %d batches of metrics of run %s did not fit the queue", self._dropped, self._run_id)
        if self._lock is not None:
            self._lock.release()
            Path(self._lock.lock_file).unlink(missing_ok=True)

    def _run(self) -> None:
        wait_s = _FIRST_WAIT_S
        deliver(self._client, self._store, (self._place,))
        while True:
            with self._change:
                while not self._queue:
                    if self._over_at_s is not None:
                        return
                    self._change.wait()
                entry = self._queue[0]
            try:
                send(self._client, self._run_id, entry)
            except Exception as error:  # MLflow, SQLAlchemy and requests each raise their own
                self._keep(error)
                with self._change:
                    if self._over_at_s is not None and time.monotonic() - self._over_at_s > _PATIENCE_S:
                        return
                    self._change.wait_for(lambda: self._over_at_s is not None, timeout=wait_s)
                if self._over_at_s is not None:
                    time.sleep(_FIRST_WAIT_S)
                wait_s = min(2.0 * wait_s, _LONGEST_WAIT_S)
                continue
            wait_s = _FIRST_WAIT_S
            with self._change:
                if self._over_at_s is not None:
                    self._over_at_s = time.monotonic()  # it takes things
                self._queue.popleft()
                if not self._queue and self._file is not None:
                    self._forget()

    def _keep(self, error: Exception) -> None:
        """From now on all that waits is on disk, too."""
        with self._change:
            if self._file is not None or self._has_given_up:
                return
            reason = str(error).split("\n")[0][:200]
            head = {"store": self._store, "run_id": self._run_id}
            text = "".join(json.dumps(line) + "\n" for line in (head, *self._queue))
            for folder in (self._place, self._spare):
                path = folder / f"{self._run_id}.jsonl"
                try:
                    folder.mkdir(parents=True, exist_ok=True)
                    self._lock = FileLock(f"{path}.lock")
                    self._lock.acquire(timeout=0)
                    write_text(path, text)
                except (ArtifactError, OSError, Timeout):
                    continue
                self._file = path
                break
            else:
                self._has_given_up = True
            where = f"{self._file}, for the next run if need be" if self._file else "memory alone"
            log.warning("MLflow at %s does not take what it is sent (%s); it waits in %s", self._store, reason, where)

    def _append(self, entry: Entry) -> None:
        assert self._file is not None
        try:
            with self._file.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(entry) + "\n")
        except OSError as error:
            log.warning("%s: %s; what MLflow is still to get is in memory alone", self._file, error.strerror)
            self._file, self._has_given_up = None, True

    def _forget(self) -> None:
        assert self._file is not None
        log.info("MLflow at %s is back; all that waited is sent", self._store)
        self._file.unlink(missing_ok=True)
        self._file = None
        if self._lock is not None:
            self._lock.release()
            Path(self._lock.lock_file).unlink(missing_ok=True)
            self._lock = None


def send(client: RunStore, run_id: str, entry: Entry) -> None:
    """Send one entry, and raise whatever a store raises that is slow or gone.

    What a store that is there refuses, it would refuse again: a warning says so, and what comes after is not held up.
    """
    try:
        _send(client, run_id, entry)
    except Exception as error:
        refusal = getattr(error, "error_code", None) in _REFUSALS or type(error) in (FileNotFoundError, PermissionError)
        if not refusal:
            raise
        reason = str(error).split("\n")[0][:200]
        log.warning("MLflow refuses the %s of run %s, which is left out: %s", entry["kind"], run_id, reason)


def _send(client: RunStore, run_id: str, entry: Entry) -> None:
    kind = entry["kind"]
    if kind == "metrics":
        client.log_metrics(run_id, entry["rows"])
    elif kind == "artifact":
        client.log_artifact(run_id, entry["path"], entry["folder"])
    elif kind == "tag":
        client.set_tags(run_id, {entry["key"]: entry["value"]})
    else:
        client.set_status(run_id, entry["status"], entry["end_time"])


def deliver(client: RunStore, store: str, folders: tuple[Path, ...]) -> None:
    """Send what earlier runs left for `store`; what it still refuses stays."""
    for path in (path for folder in folders for path in sorted(folder.glob("*.jsonl"))):
        with _claim(path) as lines:
            if not lines or lines[0].get("store") != store:
                continue
            head, *entries = lines
            sent = 0
            try:
                for entry in entries:
                    send(client, head["run_id"], entry)
                    sent += 1
            except Exception as error:  # the store is gone again, or the run is deleted
                log.info("%s: not taken yet (%s)", path, str(error).split("\n")[0][:200])
                if sent:
                    write_text(path, "".join(json.dumps(line) + "\n" for line in (head, *entries[sent:])))
            else:
                path.unlink(missing_ok=True)
                log.info("what MLflow had not taken of run %s is sent", head["run_id"])


@contextmanager
def _claim(path: Path) -> Iterator[list[dict[str, Any]]]:
    """The lines of an outbox that no other process is busy with; none where one is, or where it cannot be read."""
    lock = FileLock(f"{path}.lock")
    try:
        lock.acquire(timeout=0)
    except (Timeout, OSError):
        yield []
        return
    try:
        yield list(_lines(path))
    finally:
        lock.release()
        if not path.exists():
            Path(lock.lock_file).unlink(missing_ok=True)


def _lines(path: Path) -> Iterator[dict[str, Any]]:
    """Its entries; a last line that a killed process left half-written is left out."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError:
        return
    for line in text.splitlines():
        try:
            yield dict(json.loads(line))
        except (TypeError, ValueError):
            return

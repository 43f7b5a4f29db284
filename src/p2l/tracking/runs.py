"""Experiment tracking: what a stage measured goes to MLflow, in batches, and never half-way.

`start` opens (or resumes) a run before any compute, so that an unreachable store costs nothing. Metrics are buffered
and sent in batches, by a thread (`outbox`): one at a time costs 40 to 80 ms when several processes share a
sqlite store, and a server that has gone costs minutes. The run's id
is kept in the output folder: a process that was killed leaves its run RUNNING, and the next one with the same
configuration in the same folder continues it; work that goes on for hours with other settings (`RunCard.goes_on`) is
one run from its first start to its last. MLflow is imported to make a store and to reach a server (1.5 s), not to
write to a sqlite store that is there (`sqlite`).
"""

from __future__ import annotations

import json
import logging
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from p2l.artifacts import write_text
from p2l.errors import P2LError, TrackingError
from p2l.tracking.about import VALUE_LIMIT, RunCard, flatten, note_of, provenance
from p2l.tracking.client import RunStore
from p2l.tracking.outbox import FOLDER, IMPATIENCE, Outbox
from p2l.tracking.store import connect, experiment, safe_uri

log = logging.getLogger(__name__)
RUN_FILE = "run.json"
_PARAMS_PER_BATCH, _METRICS_PER_BATCH = 100, 1000  # MLflow's own limits
_FLUSH_AT, _FLUSH_EVERY_S = 500, 10.0


class Tracker:
    """Receives what a stage measures. This one forgets it (`tracking.enabled=false`)."""

    run_id: str | None = None

    @property
    def has_past(self) -> bool:
        """Whether it goes on with a run that has all that was recorded before."""
        return False

    def metrics(self, values: Mapping[str, float], step: int | None = None) -> None:
        """Record metrics; without a step they are the headline of the run, shown in its note."""

    def artifact(self, path: Path | str, folder: str | None = None) -> None:
        """Record a file (figure, table, video)."""

    def note(self, markdown: str) -> None:
        """Add a paragraph to the run's description."""

    def flush(self) -> None:
        """Send what is buffered."""

    def finish(self, status: str) -> None:
        """Close the run as FINISHED, FAILED or KILLED."""


@dataclass(kw_only=True)
class MlflowTracker(Tracker):
    """Sends metrics to one MLflow run."""

    client: RunStore
    card: RunCard
    run_id: str
    outbox: Outbox
    was: str | None = None
    _pending: list[tuple[str, float, int, int]] = field(default_factory=list)
    _headline: dict[str, float] = field(default_factory=dict)
    _paragraphs: list[str] = field(default_factory=list)
    _not_finite: set[str] = field(default_factory=set)
    _last_flush: float = field(default_factory=time.monotonic)
    _has_records: bool = False

    def metrics(self, values: Mapping[str, float], step: int | None = None) -> None:
        """Buffer metrics. NaN and infinity are left out and named in the tag `not_finite`: MLflow garbles them."""
        now, self._has_records = _now(), True
        for name, value in values.items():
            number = float(value)
            if not math.isfinite(number):
                self._not_finite.add(name)
                continue
            self._pending.append((name, number, now, step or 0))
            if step is None:
                self._headline[name] = number
        if len(self._pending) >= _FLUSH_AT or time.monotonic() - self._last_flush > _FLUSH_EVERY_S:
            self.flush()

    def artifact(self, path: Path | str, folder: str | None = None) -> None:
        """Copy a file to the run's artifacts."""
        self._has_records = True
        self.outbox.put("artifact", path=str(Path(path).absolute()), folder=folder)

    def note(self, markdown: str) -> None:
        """Add a paragraph to `mlflow.note.content`."""
        self._has_records = True
        self._paragraphs.append(markdown)

    def flush(self) -> None:
        """Hand buffered metrics to the queue; it does not wait for the store, since compute is worth more."""
        self._last_flush = time.monotonic()
        for first in range(0, len(self._pending), _METRICS_PER_BATCH):
            self.outbox.put("metrics", rows=self._pending[first : first + _METRICS_PER_BATCH])
        self._pending = []

    @property
    def has_past(self) -> bool:
        """Whether it goes on with a run that ended by itself; one that was killed may lack its last seconds."""
        return self.was not in (None, "RUNNING")

    @property
    def is_blank(self) -> bool:
        """Whether the run has recorded nothing yet."""
        return not self._has_records

    def discard(self) -> None:
        """Delete the run; one that was there before ends as it had."""
        if self.was is not None:
            self.outbox.put("end", status="KILLED" if self.was == "RUNNING" else self.was, end_time=_now())
            self.outbox.close()
            return
        self.outbox.close()
        try:
            self.client.delete_run(self.run_id)
        except Exception as error:  # MLflow, SQLAlchemy and requests each raise their own
            reason = safe_uri(str(error).split("\n")[0][:200])
            log.warning("MLflow did not delete the empty run %s: %s", self.run_id, reason)

    def finish(self, status: str) -> None:
        """Queue everything, the note and the end of the run, and wait until it is sent or the store fails."""
        self.flush()
        if self._not_finite:
            self.outbox.put("tag", key="not_finite", value=", ".join(sorted(self._not_finite))[:VALUE_LIMIT])
        text = note_of(self.card, self._headline, self._paragraphs)[:VALUE_LIMIT]
        self.outbox.put("tag", key="mlflow.note.content", value=text)
        self.outbox.put("end", status=status, end_time=_now())
        self.outbox.close()


@contextmanager
def start(card: RunCard, out: Path, root: Path, *, enabled: bool = True, uri: str | None = None) -> Iterator[Tracker]:
    """Open the run of `card`, or resume the one that `out` remembers, and close it with the right status.

    Args:
        card: identity of the run.
        out: the stage's output folder; keeps the run's id.
        root: the repository, for the git commit, `dvc.lock` and the default store.
        enabled: False gives a tracker that does nothing.
        uri: the store; default `MLFLOW_TRACKING_URI`, else `sqlite:///<root>/mlflow.db`.

    Raises:
        TrackingError: the store cannot be reached or refuses to write; raised before anything is computed.
    """
    if not enabled:
        yield Tracker()
        return
    store, client = connect(root, uri)
    for name, value in IMPATIENCE.items():
        os.environ.setdefault(name, value)
    tracker: MlflowTracker | None = None
    try:
        resumed = _resume(client, card, out, store)
        run_id = _create(client, card, store) if resumed is None else resumed.run_id
    except Exception as error:
        raise _refused(store, error) from error
    try:
        try:
            _describe(client, card, run_id, root, is_begun=resumed is not None and card.goes_on)
        except Exception as error:
            raise _refused(store, error) from error
        record = {"run_id": run_id, "store": safe_uri(store), "config_hash": card.config_hash}
        write_text(out / RUN_FILE, json.dumps(record) + "\n")
        outbox = Outbox(client, run_id, safe_uri(store), root / FOLDER, out / FOLDER)
        tracker = MlflowTracker(
            client=client, card=card, run_id=run_id, outbox=outbox, was=None if resumed is None else resumed.was,
            _has_records=resumed is not None and not card.goes_on,
        )  # fmt: skip
        yield tracker
    except BaseException as error:
        if tracker is not None:
            _end(tracker, error, out)
        elif _was_stopped(error):  # before there was anything that could send the end
            with suppress(Exception):
                client.set_status(run_id, "KILLED", _now())
        raise
    tracker.finish("FINISHED")


def _refused(store: str, error: Exception) -> TrackingError:
    return TrackingError(f"MLflow at {safe_uri(store)} refuses the run: {safe_uri(str(error)[:300])}")


def _end(tracker: MlflowTracker, error: BaseException, out: Path) -> None:
    """Close the run that an error has ended."""
    if isinstance(error, P2LError) and tracker.is_blank:
        tracker.discard()  # a wrong input, refused before anything was computed, is no failed experiment
        if tracker.was is None:
            (out / RUN_FILE).unlink(missing_ok=True)
        return
    tracker.note(f"Ended by `{type(error).__name__}`: {str(error)[:500]}")
    tracker.finish("KILLED" if not isinstance(error, P2LError) and _was_stopped(error) else "FAILED")


def _was_stopped(error: BaseException | None) -> bool:
    """Whether a person or a scheduler ended the run, if only while a library was imported."""
    while error is not None and isinstance(error, Exception):
        error = error.__cause__ or error.__context__
    return error is not None


def open_sweep(
    stage: str, name: str, command: str, root: Path, uri: str | None = None
) -> tuple[str, Callable[[str], None]]:
    """Create the parent run of a sweep; returns its id and a function that ends it with a status.

    Unless that is FINISHED, jobs that are still RUNNING end as KILLED: their launcher took their processes down before
    they could say so.
    """
    store, client = connect(root, uri)
    tags = {"mlflow.runName": name, "stage": stage, "kind": "sweep", **provenance(root)}
    place = experiment(client, store, stage)
    run_id = client.create_run(place, name, tags)
    note = f"Parent of a sweep; its jobs are below.\n\n```\n{command}\n```"
    client.set_tags(run_id, {"mlflow.note.content": note[:VALUE_LIMIT]})

    def close(status: str) -> None:
        try:
            client.set_status(run_id, status, _now())
            if status == "FINISHED":
                return
            for job in client.running_children(place, run_id):
                client.set_status(job, "KILLED", _now())
        except Exception as error:  # the jobs have done their work
            reason = safe_uri(str(error).split("\n")[0][:200])
            log.warning("MLflow did not take the end of the sweep %s: %s", run_id, reason)

    return run_id, close


class _Resumed(NamedTuple):
    """A run that is gone on with: its id, and its status before."""

    run_id: str
    was: str


def _resume(client: RunStore, card: RunCard, out: Path, store: str) -> _Resumed | None:
    """The run that was killed or interrupted in `out` under the same configuration, if the store still has it."""
    try:
        record = json.loads((out / RUN_FILE).read_text(encoding="utf-8"))
        is_same = record["config_hash"] == card.config_hash
        if not (is_same or card.goes_on) or record["store"] != safe_uri(store):
            return None
        run_id = str(record["run_id"])
        status = client.status(run_id)
    except Exception:  # missing, half-written or of another store: a new run is right
        return None
    if status is None or not (card.goes_on or status in ("RUNNING", "KILLED")):
        return None
    client.set_status(run_id, "RUNNING")
    return _Resumed(run_id, status)


def _create(client: RunStore, card: RunCard, store: str) -> str:
    tags = {"mlflow.parentRunId": card.parent} if card.parent else {}
    run_id = client.create_run(experiment(client, store, card.stage), card.name, tags)
    client.log_config(run_id, card.config)
    return run_id


def _describe(client: RunStore, card: RunCard, run_id: str, root: Path, *, is_begun: bool) -> None:
    """Tags and params; those of work that goes on are of its first start, as no store lets them change."""
    about = {"stage": card.stage, "world": card.world, "method": card.method, "seed": str(card.seed)}
    about |= {"config_hash": card.config_hash, "command": card.command, "mlflow.note.content": note_of(card, {}, [])}
    client.set_tags(run_id, {key: value[:VALUE_LIMIT] for key, value in (about | provenance(root)).items()})
    params = [] if is_begun else list(flatten(card.config).items())
    for first in range(0, len(params), _PARAMS_PER_BATCH):
        client.log_params(run_id, dict(params[first : first + _PARAMS_PER_BATCH]))


def _now() -> int:
    return int(time.time() * 1000)

"""Runs in a sqlite store of MLflow's, written without importing MLflow, which takes longer than planning a day.

The tables are those of the MLflow that `pyproject.toml` pins, known by the revision that the store carries; a store of
another revision, and every server, is reached by MLflow's client. What is written is what that client writes, to the
row: a test compares the two.
"""

from __future__ import annotations

import posixpath
import re
import shutil
import sqlite3
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlsplit
from urllib.request import url2pathname

from p2l.artifacts import atomic, write_text
from p2l.tracking.about import KEY_LIMIT
from p2l.tracking.client import MetricRow, MlflowStore

REVISION = "dc11669786a5"  # of MLflow 3.17.2's tables
_WAIT_S = 30.0  # for another process that is writing
_COLUMNS = ("step", "timestamp", "value")  # which of two metrics of a name is the latest
_LATER = f"({', '.join(f'excluded.{each}' for each in _COLUMNS)}) > ({', '.join(_COLUMNS)})"


class RefusalError(Exception):
    """What MLflow would refuse, with its `error_code`."""

    def __init__(self, message: str, error_code: str = "INVALID_PARAMETER_VALUE") -> None:
        super().__init__(message)
        self.error_code = error_code


class SqliteStore:
    """The runs in one file. As `RunStore` says.

    Raises:
        RefusalError: a name that MLflow does not take, a param that changes, a run that is deleted or not there.
        sqlite3.Error: the file cannot be read or written.
    """

    def __init__(self, database: Path) -> None:
        self._database = database

    def find_experiment(self, name: str) -> tuple[str, bool] | None:  # noqa: D102
        with self._transaction() as do:
            rows = do.execute("SELECT experiment_id, lifecycle_stage FROM experiments WHERE name = ?", (name,))
            row = rows.fetchone()
        return None if row is None else (str(row[0]), row[1] == "active")

    def create_experiment(self, name: str, artifacts: str | None) -> str | None:  # noqa: D102
        now = _now()
        try:
            with self._transaction() as do:
                made = do.execute(
                    "INSERT INTO experiments (name, artifact_location, lifecycle_stage, creation_time,"
                    " last_update_time) VALUES (?, ?, 'active', ?, ?)",
                    (name, artifacts, now, now),
                )
                return str(made.lastrowid)
        except sqlite3.IntegrityError:
            return None

    def create_run(self, experiment_id: str, name: str, tags: Mapping[str, str]) -> str:  # noqa: D102
        run_id = uuid.uuid4().hex
        with self._transaction() as do:
            place = do.execute("SELECT artifact_location FROM experiments WHERE experiment_id = ?", (experiment_id,))
            do.execute(
                "INSERT INTO runs (run_uuid, name, source_type, source_name, entry_point_name, user_id, status,"
                " start_time, source_version, lifecycle_stage, artifact_uri, experiment_id)"
                " VALUES (?, ?, 'UNKNOWN', '', '', ?, 'RUNNING', ?, '', 'active', ?, ?)",
                (
                    run_id,
                    name,
                    tags.get("mlflow.user", "unknown"),
                    _now(),
                    f"{place.fetchone()[0].rstrip('/')}/{run_id}/artifacts",
                    int(experiment_id),
                ),
            )
            rows = [(key, value, run_id) for key, value in ({"mlflow.runName": name} | dict(tags)).items()]
            do.executemany("INSERT INTO tags (key, value, run_uuid) VALUES (?, ?, ?)", rows)
        return run_id

    def status(self, run_id: str) -> str | None:  # noqa: D102
        with self._transaction() as do:
            row = do.execute("SELECT status, lifecycle_stage FROM runs WHERE run_uuid = ?", (run_id,)).fetchone()
        if row is None:
            raise RefusalError(f"run {run_id} is not there", "RESOURCE_DOES_NOT_EXIST")
        return str(row[0]) if row[1] == "active" else None

    def set_status(self, run_id: str, status: str, end_time: int | None = None) -> None:  # noqa: D102
        with self._run(run_id) as (do, _):
            do.execute(
                "UPDATE runs SET status = ?, end_time = coalesce(?, end_time) WHERE run_uuid = ?",
                (status, end_time, run_id),
            )

    def log_metrics(self, run_id: str, rows: Sequence[MetricRow]) -> None:  # noqa: D102
        _check_names(row[0] for row in rows)
        with self._run(run_id) as (do, _):
            many = [(name, float(value), moment, step, run_id) for name, value, moment, step in rows]
            columns = "(key, value, timestamp, step, is_nan, run_uuid) VALUES (?, ?, ?, ?, 0, ?)"
            do.executemany(f"INSERT OR IGNORE INTO metrics {columns}", many)
            do.executemany(
                f"INSERT INTO latest_metrics {columns} ON CONFLICT (key, run_uuid) DO UPDATE SET value ="
                f" excluded.value, timestamp = excluded.timestamp, step = excluded.step, is_nan = 0 WHERE {_LATER}",
                many,
            )

    def log_params(self, run_id: str, params: Mapping[str, str]) -> None:  # noqa: D102
        _check_names(params)
        with self._run(run_id) as (do, _):
            known = dict(do.execute("SELECT key, value FROM params WHERE run_uuid = ?", (run_id,)))
            if changed := [key for key, value in params.items() if known.get(key, value) != value]:
                raise RefusalError(f"param '{changed[0]}' of run {run_id} has another value already")
            rows = [(key, value, run_id) for key, value in params.items() if key not in known]
            do.executemany("INSERT INTO params (key, value, run_uuid) VALUES (?, ?, ?)", rows)

    def set_tags(self, run_id: str, tags: Mapping[str, str]) -> None:  # noqa: D102
        _check_names(tags)
        with self._run(run_id) as (do, _):
            rows = [(key, value, run_id) for key, value in tags.items()]
            do.executemany(
                "INSERT INTO tags (key, value, run_uuid) VALUES (?, ?, ?)"
                " ON CONFLICT (key, run_uuid) DO UPDATE SET value = excluded.value",
                rows,
            )

    def log_artifact(self, run_id: str, path: str, folder: str | None = None) -> None:  # noqa: D102
        place = self._artifacts(run_id)
        if place is None:
            self._elsewhere().log_artifact(run_id, path, folder)
            return
        with Path(path).open("rb") as source:
            target = place / (folder or "") / Path(path).name
            target.parent.mkdir(parents=True, exist_ok=True)
            with atomic(target) as temporary, temporary.open("wb") as copy:
                shutil.copyfileobj(source, copy)

    def log_config(self, run_id: str, config: Mapping[str, Any]) -> None:  # noqa: D102
        from yaml import safe_dump  # type: ignore[import-untyped]

        place = self._artifacts(run_id)
        if place is None:
            self._elsewhere().log_config(run_id, config)
            return
        place.mkdir(parents=True, exist_ok=True)
        write_text(place / "config.yaml", safe_dump(dict(config), indent=2, default_flow_style=False))

    def delete_run(self, run_id: str) -> None:  # noqa: D102
        with self._run(run_id) as (do, _):
            do.execute(
                "UPDATE runs SET lifecycle_stage = 'deleted', deleted_time = ? WHERE run_uuid = ?", (_now(), run_id)
            )

    def running_children(self, experiment_id: str, parent: str) -> list[str]:  # noqa: D102
        with self._transaction() as do:
            rows = do.execute(
                "SELECT runs.run_uuid FROM runs JOIN tags ON tags.run_uuid = runs.run_uuid WHERE status = 'RUNNING'"
                " AND lifecycle_stage = 'active' AND experiment_id = ? AND key = 'mlflow.parentRunId' AND value = ?",
                (int(experiment_id), parent),
            )
            return [str(row[0]) for row in rows]

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        """All of what is done, or nothing; the file has to be there."""
        uri = f"{self._database.as_uri()}?mode=rw"
        connection = sqlite3.connect(uri, uri=True, timeout=_WAIT_S, isolation_level=None)
        try:
            connection.execute("PRAGMA foreign_keys = ON")
            connection.execute("BEGIN IMMEDIATE")
            yield connection
            connection.execute("COMMIT")
        finally:
            connection.close()  # which rolls back what is not committed

    @contextmanager
    def _run(self, run_id: str) -> Iterator[tuple[sqlite3.Connection, str]]:
        """A transaction on a run that is active, and the URI of its artifacts."""
        with self._transaction() as do:
            rows = do.execute("SELECT lifecycle_stage, artifact_uri FROM runs WHERE run_uuid = ?", (run_id,))
            row = rows.fetchone()
            if row is None:
                raise RefusalError(f"run {run_id} is not there", "RESOURCE_DOES_NOT_EXIST")
            if row[0] != "active":
                raise RefusalError(f"run {run_id} is deleted")
            yield do, str(row[1])

    def _artifacts(self, run_id: str) -> Path | None:
        """Folder of a run's artifacts; None where they are on no disk of this machine."""
        with self._run(run_id) as (_, place):
            parts = urlsplit(place)
        if parts.scheme == "file" and not parts.netloc:
            return Path(url2pathname(parts.path))
        return None if parts.scheme else Path(place)

    def _elsewhere(self) -> MlflowStore:
        from mlflow import MlflowClient

        return MlflowStore(MlflowClient(tracking_uri=f"sqlite:///{quote(str(self._database))}"))


def _check_names(names: Any) -> None:
    """Refuse what MLflow refuses, since some stores keep metrics and params as files of these names."""
    for name in names:
        plain = re.fullmatch(r"[/\w.\- :]+", name) and len(name) <= KEY_LIMIT
        if not plain or posixpath.normpath(name) != name or name == "." or name.startswith(("..", "/")):
            raise RefusalError(f"'{name}' is no name of a metric, a param or a tag")


def _now() -> int:
    return int(time.time() * 1000)

"""Where runs are stored: reaching an MLflow store quickly, or saying clearly why it cannot be reached."""

from __future__ import annotations

import os
import re
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile
from urllib.parse import quote, unquote

from filelock import FileLock, Timeout

from p2l.errors import TrackingError
from p2l.tracking.client import MlflowStore, RunStore
from p2l.tracking.sqlite import REVISION, SqliteStore

_LOCK_S = 120.0
_PROBE = {  # the first contact fails in seconds; later calls keep MLflow's patience
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "0",
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "5",
}
_WORKSPACES = {"MLFLOW_ENABLE_WORKSPACES", "MLFLOW_WORKSPACE", "MLFLOW_WORKSPACE_STORE_URI"}  # left to MLflow
_WAY_OUT = "Set MLFLOW_TRACKING_URI (or tracking.uri) to a store that works, or run with tracking.enabled=false."


def safe_uri(uri: str) -> str:
    """`uri` without a password."""
    return re.sub(r"(://[^:/@]*):[^@/]*@", r"\1:***@", uri)


def default_store(root: Path) -> str:
    """URI of the sqlite store of a checkout; whatever its path holds."""
    return f"sqlite:///{quote(str(root.resolve() / 'mlflow.db'))}"


def connect(root: Path, uri: str | None = None) -> tuple[str, RunStore]:
    """The store at `uri`, after a round trip to it; MLflow is not imported for a sqlite store whose tables are known.

    Args:
        root: the repository; its `mlflow.db` is the default store.
        uri: overrides `MLFLOW_TRACKING_URI`, which overrides the default.

    Returns:
        the store's URI and the store.

    Raises:
        TrackingError: the store cannot be reached, or cannot be written.
    """
    store = uri or os.environ.get("MLFLOW_TRACKING_URI") or default_store(root)
    if not store.startswith(("http:", "https:", "sqlite:", "postgresql", "mysql", "mssql", "databricks")):
        raise TrackingError(
            f"MLflow store '{safe_uri(store)}': given neither a database nor a server; "
            f"allowed are sqlite:///<path>, http(s)://<host>, postgresql://… and mysql://…. {_WAY_OUT}"
        )
    os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
    os.environ.setdefault("MLFLOW_LOGGING_LEVEL", "WARNING")
    if (database := _database(store)) is not None:
        _make_tables(database)
        if _revision(database) == REVISION and not _WORKSPACES & set(os.environ):
            return store, SqliteStore(database)
    with _environment(_PROBE):
        try:
            from mlflow import MlflowClient

            client = MlflowClient(tracking_uri=store)
            client.search_experiments(max_results=1)
        except Exception as error:  # requests, SQLAlchemy and MLflow each raise their own
            reason = safe_uri(str(error).strip().split("\n")[0][:160])
            raise TrackingError(f"MLflow at {safe_uri(store)} cannot be reached: {reason}. {_WAY_OUT}") from error
    return store, MlflowStore(client)


def experiment(client: RunStore, store: str, name: str) -> str:
    """Id of the experiment `name`, created if need be; artifacts of a sqlite store lie beside its file."""
    database = _database(store)
    place = (database.parent / "mlartifacts" / name).as_uri() if database else None
    found = client.find_experiment(name)
    if found is None:
        if (made := client.create_experiment(name, place)) is not None:
            return made
        found = client.find_experiment(name)
    if found is None or not found[1]:
        raise TrackingError(
            f"MLflow experiment '{name}' is deleted in {safe_uri(store)}; restore it or use another store"
        )
    return found[0]


def _database(store: str) -> Path | None:
    """The file of a sqlite store."""
    if not store.startswith("sqlite:"):
        return None
    path = store.partition("://")[2].removeprefix("/").partition("?")[0]
    return Path(unquote(path)).absolute() if path else None


def _make_tables(database: Path) -> None:
    """Make the tables of a sqlite store that is not there yet, beside it, and move it into place.

    Processes that made them at the same time would crash each other, and one that is killed in the middle would leave
    a store that no later run can use. Where the store is there, nobody waits for anybody.
    """
    if not database.parent.is_dir():
        raise TrackingError(f"MLflow store {database}: no such folder {database.parent}. {_WAY_OUT}")
    if _revision(database):
        _writable(database)
        return
    from mlflow import MlflowClient  # a second that nobody has to wait for with the lock

    part = database.with_name(f".{database.name}.part")
    try:
        TemporaryFile(dir=database.parent).close()  # the lock would wait on a folder that refuses it
        with FileLock(f"{database}.lock", timeout=_LOCK_S):
            if database.is_file():
                _writable(database)
            if _revision(database):
                return
            if database.is_file() and database.stat().st_size:  # somebody else's, or from before stores were moved
                _check_whole(database)
                return
            part.unlink(missing_ok=True)
            MlflowClient(tracking_uri=f"sqlite:///{quote(str(part))}").search_experiments(max_results=1)
            part.replace(database)
    except Timeout as error:
        raise TrackingError(
            f"{database}.lock is held for {_LOCK_S:.0f} s by another process; is one hanging?"
        ) from error
    except OSError as error:
        raise TrackingError(
            f"MLflow store {database} cannot be written: {error.strerror or error}. {_WAY_OUT}"
        ) from error


def _revision(database: Path) -> str | None:
    """Of the tables of a store; None where they are not all made."""
    if not database.is_file():
        return None
    try:
        connection = sqlite3.connect(f"{database.as_uri()}?mode=ro", uri=True, timeout=30.0)
        try:
            row = connection.execute("SELECT version_num FROM alembic_version").fetchone()
        finally:
            connection.close()
    except sqlite3.Error:
        return None
    return None if row is None else str(row[0])


def _check_whole(database: Path) -> None:
    """Refuse a store whose making was interrupted by a kill: MLflow's tables without a version."""
    try:
        connection = sqlite3.connect(f"{database.as_uri()}?mode=ro", uri=True, timeout=30.0)
        try:
            tables = connection.execute("SELECT name FROM sqlite_master WHERE name = 'experiments'").fetchall()
        finally:
            connection.close()
    except sqlite3.Error:
        return
    if tables:
        raise TrackingError(
            f"MLflow store {database}: its tables are half made, by a process that was killed, so no run is in it; "
            f"move the file away. {_WAY_OUT}"
        )


def _writable(database: Path) -> None:
    """Raise at once what MLflow would retry for minutes: a read-only or foreign file."""
    try:
        connection = sqlite3.connect(database, timeout=30.0)
        try:
            connection.execute("BEGIN IMMEDIATE")
            connection.rollback()
        finally:
            connection.close()
    except sqlite3.Error as error:
        raise TrackingError(f"MLflow store {database} cannot be written: {error}. {_WAY_OUT}") from error


@contextmanager
def _environment(values: Mapping[str, str]) -> Iterator[None]:
    """Set variables that the user has not set, for a while."""
    additions = {name: value for name, value in values.items() if name not in os.environ}
    os.environ.update(additions)
    try:
        yield
    finally:
        for name in additions:
            os.environ.pop(name, None)

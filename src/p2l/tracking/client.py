"""What is asked of a store of runs, and MLflow's own client behind it.

Tests hold the two stores that there are against each other: MLflow's client, which reaches every store and takes 1.5 s
to import, and `p2l.tracking.sqlite`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from mlflow import MlflowClient

MetricRow = Sequence[Any]  # name, value (finite), milliseconds since 1970, step


class RunStore(Protocol):
    """Experiments and their runs. What a store refuses raises an error with MLflow's `error_code`."""

    def find_experiment(self, name: str) -> tuple[str, bool] | None:
        """Its id, and whether it is active; None if there is none."""

    def create_experiment(self, name: str, artifacts: str | None) -> str | None:
        """Its id; None if another process was faster. `artifacts` is the URI of the folder of its files."""

    def create_run(self, experiment_id: str, name: str, tags: Mapping[str, str]) -> str:
        """Id of a new run, which is RUNNING."""

    def status(self, run_id: str) -> str | None:
        """RUNNING, FINISHED, FAILED or KILLED; None if it is deleted."""

    def set_status(self, run_id: str, status: str, end_time: int | None = None) -> None:
        """Go on with a run, or end it at some milliseconds since 1970."""

    def log_metrics(self, run_id: str, rows: Sequence[MetricRow]) -> None:
        """Add metrics; what is there already stays once."""

    def log_params(self, run_id: str, params: Mapping[str, str]) -> None:
        """Add params; one that is there with another value is refused, and all with it."""

    def set_tags(self, run_id: str, tags: Mapping[str, str]) -> None:
        """Set tags."""

    def log_artifact(self, run_id: str, path: str, folder: str | None = None) -> None:
        """Copy a file to a folder of the run's artifacts."""

    def log_config(self, run_id: str, config: Mapping[str, Any]) -> None:
        """Write `config.yaml` to the run's artifacts."""

    def delete_run(self, run_id: str) -> None:
        """Mark a run as deleted."""

    def running_children(self, experiment_id: str, parent: str) -> list[str]:
        """Ids of the runs below `parent` that are RUNNING."""


class MlflowStore:
    """By MLflow's client, which keeps to MLflow's own rules. As `RunStore` says."""

    def __init__(self, client: MlflowClient) -> None:
        self._client = client

    def find_experiment(self, name: str) -> tuple[str, bool] | None:  # noqa: D102
        record = self._client.get_experiment_by_name(name)
        return None if record is None else (str(record.experiment_id), record.lifecycle_stage == "active")

    def create_experiment(self, name: str, artifacts: str | None) -> str | None:  # noqa: D102
        from mlflow.exceptions import MlflowException

        try:
            return str(self._client.create_experiment(name, artifact_location=artifacts))
        except MlflowException:
            return None

    def create_run(self, experiment_id: str, name: str, tags: Mapping[str, str]) -> str:  # noqa: D102
        return str(self._client.create_run(experiment_id, tags=dict(tags), run_name=name).info.run_id)

    def status(self, run_id: str) -> str | None:  # noqa: D102
        info = self._client.get_run(run_id).info
        return str(info.status) if info.lifecycle_stage == "active" else None

    def set_status(self, run_id: str, status: str, end_time: int | None = None) -> None:  # noqa: D102
        if end_time is None:
            self._client.update_run(run_id, status=status)
        else:
            self._client.set_terminated(run_id, status, end_time=end_time)

    def log_metrics(self, run_id: str, rows: Sequence[MetricRow]) -> None:  # noqa: D102
        from mlflow.entities import Metric

        self._client.log_batch(run_id, metrics=[Metric(*row) for row in rows])

    def log_params(self, run_id: str, params: Mapping[str, str]) -> None:  # noqa: D102
        from mlflow.entities import Param

        self._client.log_batch(run_id, params=[Param(key, value) for key, value in params.items()])

    def set_tags(self, run_id: str, tags: Mapping[str, str]) -> None:  # noqa: D102
        from mlflow.entities import RunTag

        self._client.log_batch(run_id, tags=[RunTag(key, value) for key, value in tags.items()])

    def log_artifact(self, run_id: str, path: str, folder: str | None = None) -> None:  # noqa: D102
        self._client.log_artifact(run_id, path, folder)

    def log_config(self, run_id: str, config: Mapping[str, Any]) -> None:  # noqa: D102
        self._client.log_dict(run_id, dict(config), "config.yaml")

    def delete_run(self, run_id: str) -> None:  # noqa: D102
        self._client.delete_run(run_id)

    def running_children(self, experiment_id: str, parent: str) -> list[str]:  # noqa: D102
        mine = f"tags.`mlflow.parentRunId` = '{parent}' and attributes.status = 'RUNNING'"
        return [run.info.run_id for run in self._client.search_runs([experiment_id], mine)]

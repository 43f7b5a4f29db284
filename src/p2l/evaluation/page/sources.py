"""The inputs of the report: the stages' output folders, by stage and domain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
import yaml  # type: ignore[import-untyped]

from p2l.artifacts import load_arrays, load_json, load_table
from p2l.contracts.domain import Domain
from p2l.domains.table import make_domain
from p2l.errors import ArtifactError
from p2l.evaluation.sheets import load_sheet
from p2l.evaluation.thesis import Thesis, load_thesis
from p2l.manifest import read_checked
from p2l.records import TransferData

if TYPE_CHECKING:
    from p2l.transfer.model import TransferModel


@dataclass(frozen=True)
class Team:
    """One domain's team experiment: results (a row per set, regime, level, method), summary, plans, thetas, study."""

    domain: str
    results: pd.DataFrame
    summary: pd.DataFrame
    plans: pd.DataFrame
    thetas: dict[str, float]
    study: dict[str, Any]

    def costs(self, regime: str) -> dict[str, float]:
        """c_rob, c_hum, c_fail, c_demo of a regime."""
        return {name: float(value) for name, value in self.study["regimes"][regime].items() if name != "levels"}

    @property
    def sets(self) -> str:
        """The task sets behind means and intervals, in words."""
        number, blocks = self.results["set"].nunique(), self.results["block"].nunique()
        origin = {number: "each with tasks and skills of its own", 1: "all drawn from one pool of tasks"}.get(
            blocks, f"drawn from {blocks} pools of tasks"
        )
        if self.study["orders"]:
            return f"{number} given orders of {int(self.results['n_tasks'].iloc[0])} tasks"
        return f"{number} sets of {int(self.results['n_tasks'].iloc[0])} tasks, {origin}"


@dataclass(frozen=True)
class Sources:
    """The pipeline's folders.

    Attributes:
        data: folder with one folder per stage.
        thesis: folder of the thesis's numbers.
        domains: domains of the pipeline; those of `data` that are not among them are ignored.
        worlds: the same for manipulation worlds.
        recovery_worlds: those of them that learn recoveries to preconditions.
        chain_worlds: those of them that learn where and how to recover.
        results: folder of tables that scripts have made from the records of the thesis preset, if there is one.
    """

    data: Path
    thesis: Path
    domains: tuple[str, ...]
    worlds: tuple[str, ...] = ()
    recovery_worlds: tuple[str, ...] = ()
    chain_worlds: tuple[str, ...] = ()
    results: Path | None = None

    def committed(self, name: str, columns: Sequence[str]) -> pd.DataFrame | None:
        """A table of `results`, or None where there is none.

        Raises:
            ArtifactError: unreadable, or without one of the columns.
        """
        path = None if self.results is None else self.results / f"{name}.csv"
        if path is None or not path.is_file():
            return None
        try:
            table = pd.read_csv(path)
        except (OSError, ValueError) as error:
            raise ArtifactError(f"{path}: cannot be read ({error})") from error
        if lacking := [column for column in columns if column not in table]:
            raise ArtifactError(f"{path}: lacks columns {', '.join(lacking)}")
        return table

    def chapter(self, number: int) -> Thesis:
        """Numbers and claims of a chapter."""
        return load_thesis(self.thesis, number)

    def file(self, stage: str, domain: str, name: str) -> Path:
        """A stage's file."""
        return self.data / stage / domain / name

    def config(self, stage: str, domain: str) -> dict[str, Any]:
        """A stage's resolved configuration."""
        path = self.file("config", domain, f"{stage}.yaml")
        try:
            return dict(yaml.safe_load(read_checked(path, "run `dvc repro config`").decode("utf-8")))
        except (ValueError, TypeError, yaml.YAMLError) as error:
            raise ArtifactError(f"{path}: no readable configuration ({error}); run `dvc repro config`") from error

    def team(self, domain: str) -> Team | None:
        """A domain's team experiment, or None if the pipeline leaves the domain out."""
        if domain not in self.domains:
            return None
        folder = self.data / "evaluate_team" / domain
        return Team(
            domain,
            load_table(folder / "results.parquet", schema="team_results", version=1),
            load_table(folder / "summary.parquet", schema="team_summary", version=1),
            load_table(self.file("plan", domain, "plans.parquet"), schema="plans", version=1),
            load_json(self.file("plan", domain, "summary.json"), schema="plan_summary", version=1)["thetas"],
            self.config("evaluate_team", domain)["study"],
        )

    def collection(self, domain: str) -> dict[str, Any]:
        """Summary of a domain's data collection."""
        return load_json(self.file("collect", domain, "summary.json"), schema="collect_summary", version=1)

    def transfer(self, domain: str) -> TransferData:
        """Simulated transfer between a domain's tasks."""
        return TransferData.from_arrays(
            load_arrays(self.file("collect", domain, "transfer_data.npz"), schema="transfer_data", version=1)
        )

    def scores(self, domain: str) -> list[dict[str, Any]]:
        """Scores of a domain's predictor and its baselines on held-out tasks, then on the pairs that plans rely on."""
        path = self.file("fit_transfer", domain, "metrics.json")
        planned = self.file("evaluate_team", domain, "predictions.json")
        return [
            *load_json(path, schema="fit_transfer_metrics", version=1)["scores"],
            *load_json(planned, schema="planned_predictions", version=1)["scores"],
        ]

    def discovery(self, world: str) -> dict[str, Any]:
        """Summary of a world's failure discovery."""
        return load_json(self.file("discover", world, "summary.json"), schema="discover_summary", version=1)

    def clustering(self, world: str) -> dict[str, Any]:
        """Summary of a world's failure modes."""
        return load_json(self.file("cluster", world, "summary.json"), schema="cluster_summary", version=1)

    def videos(self, world: str, stage: str = "cluster") -> tuple[list[tuple[dict[str, Any], bytes]], str | None]:
        """(entry of `videos.json`, mp4) of each video, and the reason if there is none."""
        folder = self.data / stage / world / "videos"
        index = load_json(folder / "videos.json", schema="videos", version=1)
        films = []
        for one in index["videos"]:
            path = folder / str(one["file"])
            if not path.resolve().is_relative_to(folder.resolve()):  # the page would embed any file of this machine
                raise ArtifactError(f"{folder / 'videos.json'}: names '{one['file']}', which lies outside its folder")
            films.append((one, read_checked(path, f"run `dvc repro {stage}`")))
        return films, index["skipped"]

    def sheet(self, stage: str, domain: str, name: str) -> pd.DataFrame:
        """A CSV that a stage wrote."""
        return load_sheet(self.file(stage, domain, name), (), f"run `dvc repro {stage}`")

    def image(self, stage: str, domain: str, name: str) -> bytes:
        """A PNG that a stage drew."""
        return read_checked(self.file(stage, domain, name), f"run `dvc repro {stage}`")

    def world(self, domain: str) -> Domain:
        """The task distribution, as the data were collected."""
        config = self.config("collect", domain)["domain"]
        return make_domain(config.get("target", config["name"]), config["params"])

    def model(self, domain: str) -> TransferModel:
        """The fitted predictor."""
        from p2l.transfer.model import load_transfer_model

        world = self.world(domain)
        path = self.file("fit_transfer", domain, "transfer_model.safetensors")
        return load_transfer_model(path, feature_names=world.feature_names, encoding=world.encoding)

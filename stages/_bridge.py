"""Between a stage's configuration, the records of `p2l`, and the tracker."""

from __future__ import annotations

import dataclasses
import json
import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from p2l.artifacts import config_hash, write_text
from p2l.closure import code_digest
from p2l.schema import EvaluateTeamConfig, PlanConfig, StageConfig
from p2l.tracking import Tracker
from stages import ROOT

if TYPE_CHECKING:  # who leaves no figures needs no matplotlib
    from p2l.evaluation.sheets import StageReport

TIMES_FILE = "times.json"  # beside the outputs, and none of them: it differs from machine to machine


def code_of(name: str, cfg: StageConfig, records: Path | None) -> str:
    """Hash of the code behind a stage's records.

    Committed records outlive harmless edits of ours: the rooms' VERSION marks those that they do not outlive. What a
    person brings has none, so its code always counts.

    Args:
        name: of the stage.
        cfg: its configuration.
        records: folder of committed records, if there is one.
    """
    if records:
        return cfg.outside_code
    return config_hash([code_digest(f"stages.{name}", {"stages": ROOT / "stages"}), cfg.outside_code])


def ledger_of(name: str, cfg: PlanConfig | EvaluateTeamConfig, out: Path) -> tuple[Path, str]:
    """Folder of the records of a stage on a study's sets, and the hash of what decides its blocks besides their tasks.

    Committed records outlive harmless edits (`TRUTH_VERSION`, `PRETRAINED_VERSION` mark others); a run's own do not.
    """
    code = code_of(name, cfg, cfg.records)
    return cfg.records or out / "records", config_hash([cfg.identity, code]) if code else cfg.identity


def fields_of(cfg: BaseModel, record: type[Any]) -> dict[str, Any]:
    """The values of a configuration that a frozen record has fields for."""
    return {field.name: getattr(cfg, field.name) for field in dataclasses.fields(record) if hasattr(cfg, field.name)}


def tell(track: Tracker, report: StageReport, log: logging.Logger | None = None, more: Sequence[Path] = ()) -> None:
    """Hand everything to the tracker, `more` files too; notes also go to the log, if there is one."""
    track.metrics(report.metrics)
    for path in (*report.files, *more):
        track.artifact(path)
    for line in report.notes:
        track.note(line)
        if log is not None:
            log.warning(line)


def tell_times(track: Tracker, out: Path, times: Mapping[str, float]) -> None:
    """Wall times and rates go to the tracker and to an untracked file: outputs are functions of inputs."""
    write_text(out / TIMES_FILE, json.dumps({name: round(value, 3) for name, value in times.items()}, indent=1) + "\n")
    track.metrics(times)

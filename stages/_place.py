"""The output folder of a stage: what a person has in it stays, and a stopped run goes on.

A stage refuses, before it computes anything, where it would write over a file that no stage has written. While it runs,
a note in the folder names it: a run that was stopped knows from it that the files there are its own. Of two runs at
once in one folder the second is refused; they are told apart on one machine, not on two that share a disk.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, ClassVar

from filelock import FileLock, Timeout
from hydra.experimental.callback import Callback
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from p2l.artifacts import config_hash, write_text
from p2l.errors import ArtifactError
from p2l.manifest import check_files
from p2l.tracking import RUN_FILE

CONFIG_FILE, LOG_FILE, NOTE_FILE = "config.yaml", "stage.log", ".unfinished.json"
Stamps = Mapping[Path, tuple[int, int, int]]  # time of the last change in ns, size and inode of files
_ALL = (CONFIG_FILE, RUN_FILE, "times.json")
# What each stage writes, as patterns of paths in its folder; records, checkpoints and runs of children have checks of
# their own.
WRITES: Mapping[str, tuple[str, ...]] = {
    "ask": (
        "plan.csv", "plan.json", "reasons.csv", "certificate.npz", "questions.csv", "expected_orders.csv",
    ),
    "chain_recoveries": ("*.csv", "summary.json", "policy.safetensors*", "policies/**/*"),
    "check_plan": (),
    "cluster": ("modes.*", "labels.npz", "videos/*", "summary.json"),
    "collect": ("transfer_data.npz", "strategy.png", "summary.json"),
    "config": ("*/**/*",),  # it deletes the folders of items that are no more
    "day": ("rest.csv", "changes.csv"),  # day.csv, which people correct, names its plan itself
    "discover": ("failures_*.npz", "summary.json"),
    "evaluate_chains": ("*.csv", "*.png", "episodes.parquet", "videos/*", "summary.json"),
    "evaluate_recoveries": ("*.csv", "*.png", "episodes.parquet", "summary.json"),
    "evaluate_team": ("results.parquet", "predictions.json", "summary.parquet"),
    "export": ("policy.onnx*",),
    "fit_preconditions": ("preconditions.*", "samples.npz", "*.csv", "summary.json"),
    "fit_transfer": ("transfer_model.safetensors*", "calibration.*", "metrics.json"),
    "iterate_recoveries": ("success.*", "summary.json", "s[0-9]*/**/*"),
    "learn_recoveries": ("*.csv", "*.png", "recoveries/*", "histories/*", "graphs/*", "videos/*", "summary.json"),
    "plan": (
        "plan.csv", "plan.json", "plan.png", "plan.html", "reasons.csv", "tomorrow.csv", "certificate.npz", "shop.npz",
        "plans.parquet", "summary.json",
    ),
    "predict_transfer": ("transfer.csv", "transfer.png", "next_trials.csv", "summary.json"),
    "report": ("index.html", "tables/*", "figures/*", "metrics.json", "headline.json"),
    "watch": ("*.mp4",),
}  # fmt: skip


@contextmanager
def alone(out: Path) -> Iterator[None]:
    """No other run is at work in the folder meanwhile; a run that is killed is at work no longer.

    Raises:
        ArtifactError: one is.
    """
    name = f"p2l-{os.getuid()}-{config_hash(str(out.resolve()))}.lock"
    lock = FileLock(Path(tempfile.gettempdir()) / name)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        raise ArtifactError(
            f"{out}: another run is at work in this folder; wait until it has ended, or name another one "
            "(hydra.run.dir)"
        ) from None
    try:
        yield
    finally:
        lock.release()


def claim(stage: str, out: Path) -> None:
    """Refuse a folder in which the stage would write over somebody's file; else note that the stage is at work there.

    Raises:
        ArtifactError: there is such a file, or the folder cannot be written.
    """
    if _noted(out) != stage:
        check_files(out, (*_ALL, *WRITES[stage]))
        write_text(out / NOTE_FILE, json.dumps({"stage": stage}) + "\n")


def release(out: Path) -> None:
    """The stage has finished: its manifest says what is its own."""
    (out / NOTE_FILE).unlink(missing_ok=True)


def stamps(out: Path) -> Stamps:
    """Every file in a folder, with what changes when it is written."""
    found = {}
    for file in out.rglob("*"):
        if file.is_file():
            status = file.stat()
            found[file] = (status.st_mtime_ns, status.st_size, status.st_ino)
    return found


def written(out: Path, before: Stamps) -> set[Path]:
    """What a stage has written since, new files and others anew, but for what every stage writes."""
    now = stamps(out)
    return {file for file in now if now[file] != before.get(file)} - {out / RUN_FILE, out / LOG_FILE, out / NOTE_FILE}


class NewFolders(Callback):
    """Notes, before Hydra makes a run's folder, which of the folders above it there are not; see `clear`."""

    above: ClassVar[list[Path]] = []  # the lowest first

    def on_run_start(self, config: DictConfig, **_: Any) -> None:
        """Of a single run; those of a sweep lie in a folder that stays."""
        self.above.clear()
        with suppress(OmegaConfBaseException, OSError):  # what is wrong with the place, Hydra will say
            place = Path(str(config.hydra.run.dir)).absolute()
            self.above.extend(folder for folder in place.parents if not folder.exists())


def clear(out: Path, before: Stamps) -> None:
    """Take away what every stage writes, so that a refused input leaves what was there `before`, or nothing."""
    new = {out / RUN_FILE, out / LOG_FILE, out / NOTE_FILE} - set(before)
    if written(out, before):  # it is the stage's own only with the note
        new.discard(out / NOTE_FILE)
    for file in new:
        file.unlink(missing_ok=True)
    if before or any(out.iterdir()):
        return
    out.rmdir()
    for folder in NewFolders.above:
        if folder not in out.parents or any(folder.iterdir()):
            return
        folder.rmdir()


def _noted(out: Path) -> str | None:
    """The stage that was stopped here."""
    try:
        return str(dict(json.loads((out / NOTE_FILE).read_text(encoding="utf-8")))["stage"])
    except (OSError, ValueError, TypeError, KeyError):
        return None

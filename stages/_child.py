"""Child runs inside one stage: one for each seed and method that it trains, all under the stage's own run."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from p2l.artifacts import write_text
from p2l.errors import TrackingError
from p2l.schema import StageConfig
from p2l.tracking import RUN_FILE, RunCard, Tracker, start
from stages import ROOT

log = logging.getLogger(__name__)
PARENT_FILE = "parent.json"


@contextmanager
def child(parent: Tracker, cfg: StageConfig, stage: str, method: str, seed: int, folder: Path) -> Iterator[Tracker]:
    """A run below `parent`; `folder` remembers its id and whose child it is.

    A child whose store has gone since its parent began goes untracked, with a warning.
    A child that was interrupted is continued if its parent is. One that was finished under the same parent has told
    everything: what is told again goes nowhere.
    """
    folder.mkdir(parents=True, exist_ok=True)
    memory = _memory(folder)
    if parent.run_id is not None and memory == {"parent": parent.run_id, "finished": True}:
        yield Tracker()
        return
    if memory.get("parent") != parent.run_id:
        (folder / RUN_FILE).unlink(missing_ok=True)
    card = RunCard(
        stage=stage,
        world=cfg.subject,
        method=method,
        seed=seed,
        config=cfg.model_dump(mode="json", exclude={"tracking"}),
        config_hash=cfg.hash,
        command=f"# part of the parent run: method {method}, seed {seed}",
        parent=parent.run_id,
    )
    _remember(folder, parent.run_id, finished=False)
    with ExitStack() as stack:
        run = start(card, folder, ROOT, enabled=parent.run_id is not None, uri=cfg.tracking.uri)
        try:
            track = stack.enter_context(run)
        except TrackingError as error:  # the store was there when the stage began, and the work is worth more
            log.warning("%s, seed %d: goes untracked, since %s", method, seed, error)
            yield Tracker()
            return
        yield track
    _remember(folder, parent.run_id, finished=True)


def _memory(folder: Path) -> dict[str, object]:
    try:
        return dict(json.loads((folder / PARENT_FILE).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return {}


def _remember(folder: Path, parent: str | None, *, finished: bool) -> None:
    write_text(folder / PARENT_FILE, json.dumps({"parent": parent, "finished": finished}) + "\n")

"""Child runs inside one stage: one for each seed and method that it trains, all under the stage's own run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from p2l.schema import StageConfig
from p2l.tracking import RunCard, Tracker, start
from stages import ROOT


@contextmanager
def child(parent: Tracker, cfg: StageConfig, stage: str, method: str, seed: int, folder: Path) -> Iterator[Tracker]:
    """A run below `parent`; `folder` remembers its id, so that an interrupted one is continued."""
    card = RunCard(
        stage=stage,
        world=cfg.subject,
        method=method,
        seed=seed,
        config=cfg.model_dump(mode="json"),
        config_hash=cfg.hash,
        command=f"# part of the parent run: method {method}, seed {seed}",
        parent=parent.run_id,
    )
    folder.mkdir(parents=True, exist_ok=True)
    with start(card, folder, ROOT, enabled=parent.run_id is not None, uri=cfg.tracking.uri) as track:
        yield track

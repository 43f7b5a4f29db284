"""The archive of a stage's files among the committed records, known by its configuration and its input files."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from p2l.archive import Archive, digest_of
from p2l.artifacts import config_hash
from p2l.ledger import Item
from p2l.schema import ArchivedStageConfig

# Of a configuration, what changes no file that is kept: beside what changes no result, films and episodes at once.
_IDLE = {"videos": True, "video": True, "slots": True, "domain": {"params": {"nthread", "encoding"}}}


def make_or_restore(
    stage: str,
    version: int,
    cfg: ArchivedStageConfig,
    out: Path,
    names: Sequence[str],
    make: Callable[[], None],
    world: str = "",
) -> None:
    """Take a stage's files from the committed records, or make them and keep them there; see `archive_of`."""
    archive = archive_of(stage, version, cfg, names, world)
    if not archive.restore(out):
        begin = time.perf_counter()
        make()
        archive.keep(out, seconds=time.perf_counter() - begin)


def archive_of(stage: str, version: int, cfg: ArchivedStageConfig, names: Sequence[str], world: str = "") -> Archive:
    """Where the files of a stage are kept, and found again.

    Args:
        stage: its name.
        version: of the code behind it; raised when an edit changes the files: committed records know no code of ours.
        cfg: its configuration; paths in it count by the bytes that lie there.
        names: of the files.
        world: digest of the world that is simulated, if there is one and no input file holds it; or what else of it
            decides the files and no value of the configuration says.

    Raises:
        ArtifactError: an input file is missing.
    """
    if cfg.records is None:
        return Archive(None, Item(cfg.subject, stage, cfg.seed, 0, ""), names)
    values: dict[str, Any] = cfg.model_dump(mode="json", exclude=cfg.idle | _IDLE)
    inputs = {name: getattr(cfg, name) for name in values}
    values |= {name: digest_of(value) for name, value in inputs.items() if isinstance(value, Path)}
    identity = config_hash([stage, version, values, cfg.outside_code, world])
    return Archive(cfg.records, Item(cfg.subject, stage, cfg.seed, 0, identity), names)

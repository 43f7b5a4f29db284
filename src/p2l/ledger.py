"""The ledger of finished items: one small committed file per (world, method, seed, block).

A run at thesis scale takes hours and may be cut. Each finished item leaves its rows, the hash of the configuration
that made them, its seed and its wall time; an item whose record matches its configuration is not run again, on this
machine or on the next, and tables are built from the records.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from p2l.artifacts import load_json, save_json
from p2l.errors import ArtifactError

log = logging.getLogger(__name__)
SCHEMA = "item_record"


@dataclass(frozen=True)
class Item:
    """What a record is about.

    Attributes:
        world: domain or world.
        method: learner, chooser, planner, or `truth` for what they are compared against.
        seed: the seed of the experiment.
        block: which part of it, 0 where there is only one.
        config_hash: hash of all that decides the result.
    """

    world: str
    method: str
    seed: int
    block: int
    config_hash: str

    @property
    def file(self) -> str:
        """Name of the record."""
        return f"{self.world}-{self.method}-s{self.seed}-b{self.block}.json"


def find(folder: Path, item: Item) -> dict[str, Any] | None:
    """The content of an item's record, or None if there is none, it is damaged, or another configuration made it."""
    record = _read(folder / place(folder, item))
    if record is None or record["config_hash"] != item.config_hash:
        return None
    content: dict[str, Any] = record["content"]
    return content


def place(folder: Path, item: Item) -> str:
    """Name of an item's record in `folder`.

    Where a whole record of another configuration has that name, the hash is added: hours of work are not overwritten.
    """
    record = _read(folder / item.file)
    if record is None or record["config_hash"] == item.config_hash:
        return item.file
    return f"{item.file.removesuffix('.json')}-{item.config_hash}.json"


def _read(path: Path) -> dict[str, Any] | None:
    try:
        return load_json(path, schema=SCHEMA, version=1)
    except ArtifactError as error:
        if path.is_file():
            log.warning("%s; its item is made anew", error)
        return None


def write(folder: Path, item: Item, content: dict[str, Any], *, seconds: float) -> None:
    """Leave the record of a finished item; `seconds` is its wall time."""
    record = {
        "world": item.world,
        "method": item.method,
        "seed": item.seed,
        "block": item.block,
        "config_hash": item.config_hash,
        "seconds": round(seconds, 3),
        "content": content,
    }
    save_json(folder / place(folder, item), record, schema=SCHEMA, version=1)

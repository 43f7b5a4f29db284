"""What is told of a run besides its metrics: params, a note, and where the code was."""

from __future__ import annotations

import functools
import getpass
import json
import logging
import os
import shlex
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path
from typing import Any

log = logging.getLogger(__name__)
KEY_LIMIT, VALUE_LIMIT = 250, 6000  # MLflow's own


@dataclass(frozen=True)
class RunCard:
    """What identifies a run.

    Attributes:
        stage: the MLflow experiment.
        world, method, seed: give the run its name and three of its tags.
        config: the resolved configuration, plain data.
        config_hash: its hash; where metrics go should not be part of it.
        command: runs it again.
        parent: run id of the sweep that this run belongs to, or None.
        goes_on: it goes on with the run of its folder, whatever the end of that and its configuration.
    """

    stage: str
    world: str
    method: str
    seed: int
    config: Mapping[str, Any]
    config_hash: str
    command: str
    parent: str | None = None
    goes_on: bool = False

    @property
    def name(self) -> str:
        """The run's name, `<world>-<method>-s<seed>`."""
        return f"{self.world}-{self.method}-s{self.seed}"


def flatten(config: Mapping[str, Any], prefix: str = "") -> dict[str, str]:
    """Dotted keys and short text values that MLflow accepts as params; a key that is too long ends in its hash."""
    flat: dict[str, str] = {}
    for name, value in config.items():
        key = f"{prefix}{name}"
        if isinstance(value, Mapping) and value:
            flat |= flatten(value, f"{key}.")
            continue
        if len(key) > KEY_LIMIT:
            key = f"{key[: KEY_LIMIT - 9]}-{blake2b(key.encode(), digest_size=4).hexdigest()}"
        text = value if isinstance(value, str) else json.dumps(value, default=str)
        flat[key] = text if len(text) <= VALUE_LIMIT else text[: VALUE_LIMIT - 1] + "…"
    return flat


def note_of(card: RunCard, headline: Mapping[str, float], paragraphs: list[str]) -> str:
    """The run's description: how to run it again, its headline numbers, and what was noted."""
    rows = "\n".join(f"| {name} | {value:.6g} |" for name, value in headline.items())
    table = f"| metric | value |\n| --- | --- |\n{rows}\n\n" if rows else ""
    text = "\n\n".join(paragraphs)
    return f"**{card.stage}** {card.name}\n\nRun it again:\n```\n{card.command}\n```\n\n{table}{text}"


def _user() -> str:
    """The person's name, or the number of a user that this machine has no entry for, as in a container."""
    try:
        return getpass.getuser()
    except (KeyError, OSError, ImportError):
        return str(os.getuid()) if hasattr(os, "getuid") else "unknown"


@functools.cache
def _tell_of_owner(root: Path) -> None:
    log.warning(
        "%s belongs to another user, so git refuses it, and runs carry neither commit nor dirty flag; "
        "to trust it: git config --global --add safe.directory %s", root, shlex.quote(str(root)),
    )  # fmt: skip


def provenance(root: Path) -> dict[str, str]:
    """Commit, dirty flag and hash of `dvc.lock`; empty outside a git checkout.

    A warning says so where git refuses a checkout that is there, because it belongs to another user.
    """

    def git(*arguments: str) -> str | None:
        try:
            run = subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True, timeout=20)
        except (OSError, subprocess.SubprocessError):
            return None
        if "safe.directory" in run.stderr:
            _tell_of_owner(root)
        return run.stdout.strip() if run.returncode == 0 else None

    tags = {"mlflow.user": _user(), "mlflow.source.type": "LOCAL"}
    if commit := git("rev-parse", "HEAD"):
        tags |= {"git_commit": commit, "mlflow.source.git.commit": commit}
        tags["git_dirty"] = str(bool(git("status", "--porcelain", "--untracked-files=no"))).lower()
    if (lock := root / "dvc.lock").is_file():
        tags["dvc_lock"] = blake2b(lock.read_bytes(), digest_size=8).hexdigest()
    return tags

"""The parent run of a sweep: a Hydra callback opens it before the first job, and the jobs become its children."""

from __future__ import annotations

import atexit
import os
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hydra.experimental.callback import Callback
from omegaconf import DictConfig, open_dict

from p2l.errors import P2LError
from p2l.text import printable
from p2l.tracking import open_sweep, safe_uri
from stages import ROOT
from stages._stage import PARENT_VARIABLE, STOPPED_VARIABLE


class ParentRun(Callback):
    """Opens a parent run when a sweep starts and closes it when it ends, whatever its end."""

    def __init__(self) -> None:
        self._close: Callable[[str], None] | None = None

    def on_multirun_start(self, config: DictConfig, **_: Any) -> None:
        """Open the parent and hand its id to every job's environment, wherever a launcher runs it."""
        if not config.tracking.enabled:
            return
        name = config.hydra.job.name
        command = safe_uri(shlex.join(["python", "-m", f"stages.{name}", *sys.argv[1:]]))
        try:
            run_id, self._close = open_sweep(
                name, Path(config.hydra.sweep.dir).name, command, ROOT, config.tracking.uri
            )
        except P2LError as error:
            print(f"stage {name}: {printable(str(error))}", file=sys.stderr)
            raise SystemExit(error.exit_code) from None  # Hydra turns an exception of a callback into a warning
        atexit.register(lambda: self._end("KILLED" if STOPPED_VARIABLE in os.environ else "FAILED"))
        with open_dict(config):
            config.hydra.overrides.hydra.append(f"+hydra.job.env_set.{PARENT_VARIABLE}={run_id}")

    def on_multirun_end(self, config: DictConfig, **_: Any) -> None:  # noqa: ARG002
        """All jobs ended well."""
        self._end("FINISHED")

    def _end(self, status: str) -> None:
        if self._close is not None:
            self._close(status)
            self._close = None

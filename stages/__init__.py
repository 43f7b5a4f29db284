"""Stages: load, call `p2l`, save. The only code that sees Hydra and tracking.

A checkout runs its own `p2l`, whichever one the environment has installed: DVC watches these files, so these are the
ones that must run.
"""

import os
import signal
import sys
from pathlib import Path
from typing import NoReturn

ROOT = Path(__file__).resolve().parent.parent

if (_SOURCE := str(ROOT / "src")) not in sys.path:
    sys.path.insert(0, _SOURCE)


def _stop(number: int, frame: object) -> NoReturn:  # noqa: ARG001
    """Ctrl-C while a stage is imported, which takes up to a second: one line, since there is nothing to tidy up."""
    os.write(2, b"stopped by Ctrl-C before anything was begun\n")
    os._exit(130)


def begin() -> None:
    """From here on, Ctrl-C is the stage's own matter."""
    if signal.getsignal(signal.SIGINT) is _stop:
        signal.signal(signal.SIGINT, signal.default_int_handler)


if sys.argv[:1] == ["-m"] and signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # python -m stages.…
    signal.signal(signal.SIGINT, _stop)

"""How the room's kernels are compiled: cached beside the sources, or where that cannot be, in a temporary folder."""

from __future__ import annotations

import os
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numba as nb
from numba.core import config


def _can_write(folder: Path) -> bool:
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _place_cache() -> None:
    """Give numba a folder for its cache where it has none: a read-only checkout and no home that can be written."""
    if "NUMBA_CACHE_DIR" in os.environ or _can_write(Path(__file__).parent):
        return
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
    if any(_can_write(folder) for folder in (home, home.parent) if folder.is_dir()):
        return
    folder = tempfile.mkdtemp(prefix="p2l-kernels-")
    config.CACHE_DIR = folder
    warnings.warn(f"neither the checkout nor {home} can be written; kernels are compiled into {folder}", stacklevel=2)


_place_cache()


def kernel(function: Any) -> Any:
    """Compile a function; it runs without the interpreter's lock, so that a timer can raise a flag meanwhile."""
    return nb.njit(cache=True, nogil=True)(function)

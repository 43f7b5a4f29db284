"""Items of the ledger: what is not there yet is made, timed and kept."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from p2l.ledger import Item, find, write


def recorded(records: Path, item: Item, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """The content of an item's record; where there is none, what `make` returns, which is timed and leaves one."""
    if (content := find(records, item)) is None:
        start = time.perf_counter()
        content = make()
        write(records, item, content, seconds=time.perf_counter() - start)
    return content

"""Ctrl-C and SIGTERM kept until a library has been imported: some swallow every exception while they look around."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_STOPS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def deferred_stops() -> Iterator[None]:
    """Deliver a stop that comes inside when the block ends, so that no bare `except` inside can take it.

    robosuite looks for optional packages in such ones while it is imported; a stop in that moment was lost, and the
    process worked on. Outside the main thread, which alone gets signals, nothing is done.
    """
    handlers = {number: signal.getsignal(number) for number in _STOPS}
    if threading.current_thread() is not threading.main_thread() or None in handlers.values():
        yield
        return
    pending: list[int] = []

    def keep(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
        pending.append(number)

    for number in _STOPS:
        signal.signal(number, keep)
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        if pending:
            signal.raise_signal(pending[0])

"""Standard output whose reader may leave, as in `… | head -1`: what the stage does goes on, and ends as it would."""

from __future__ import annotations

import io
import os
import sys
from typing import Any


class Listener:
    """A text stream; from the moment on that nobody reads it, what is written goes nowhere."""

    def __init__(self, stream: io.TextIOWrapper) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write and flush, so that a reader who has left is noticed here."""
        try:
            self._stream.write(text)
            self._stream.flush()
        except BrokenPipeError:
            self._leave()
        return len(text)

    def flush(self) -> None:
        """Flush what other writers have left."""
        try:
            self._stream.flush()
        except BrokenPipeError:
            self._leave()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def _leave(self) -> None:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())  # what the stream still holds goes there when Python ends
        os.close(nowhere)


def listen() -> None:
    """Put a `Listener` in the place of standard output, if that is a stream of this process."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout = Listener(sys.stdout)

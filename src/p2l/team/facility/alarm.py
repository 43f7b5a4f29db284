"""A deadline that compiled loops can see: a flag that a timer raises."""

from __future__ import annotations

import threading
import time
from types import TracebackType

import numpy as np
import numpy.typing as npt

Flag = npt.NDArray[np.uint8]


def silent() -> Flag:
    """A flag that nobody raises."""
    return np.zeros(1, dtype=np.uint8)


class Alarm:
    """Raises `flag` at the `deadline` of `time.perf_counter`; kernels that are given it stop at a state that is valid.

    They run without the interpreter's lock, else the timer could not raise it.
    """

    def __init__(self, deadline: float) -> None:
        self.deadline, self.flag = deadline, silent()
        self._timer = threading.Timer(max(0.0, deadline - time.perf_counter()), self._ring)
        self._timer.daemon = True

    def __enter__(self) -> Alarm:
        if time.perf_counter() >= self.deadline:
            self._ring()
        elif self.deadline - time.perf_counter() < threading.TIMEOUT_MAX:
            self._timer.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._timer.cancel()

    @property
    def rang(self) -> bool:
        """Whether the deadline has passed."""
        return bool(self.flag[0]) or time.perf_counter() >= self.deadline

    def _ring(self) -> None:
        self.flag[0] = 1

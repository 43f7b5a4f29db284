"""Solvers are loaded beside the work, so that a time limit holds from the first call of a process on.

Importing Pyomo takes half a second, loading compiled kernels as long, and compiling them on a fresh installation a
quarter of a minute; none of it can be interrupted. A caller waits for it until its deadline and no longer; what has
been begun goes on, and the next call finds it done.
"""

from __future__ import annotations

import functools
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

T = TypeVar("T")


def loaded(load: Callable[[], T], deadline: float) -> T:
    """What `load` returns, which is called once per process.

    Args:
        load: a function of a module, the same object every time.
        deadline: of `time.perf_counter`.

    Raises:
        TimeoutError: it is not loaded by the deadline.
    """
    return _started(load).result(timeout=max(0.0, min(deadline - time.perf_counter(), threading.TIMEOUT_MAX)))


@functools.cache
def _started(load: Callable[[], T]) -> Future[T]:
    future: Future[T] = Future()

    def run() -> None:
        try:
            future.set_result(load())
        except BaseException as error:
            future.set_exception(error)

    threading.Thread(target=run, name=f"loading {load.__module__}", daemon=True).start()  # the end waits for none
    return future

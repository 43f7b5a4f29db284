"""A process that runs one environment, as its parent sees it: how it starts, what it shares, how it ends."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import tempfile
from collections import deque
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import IO, Any


@dataclass(frozen=True)
class Task:
    """What a process is to do for the row of a lane; `goes_on`: from where the lane's last job has ended."""

    ticket: int
    lane: int
    what: str
    content: Any
    goes_on: bool


@dataclass
class WorkerProcess:
    """One process, the tasks that it has been given, and the lane whose row its environment is at."""

    process: subprocess.Popen[bytes]
    connection: Connection
    errors: IO[bytes]
    tasks: deque[Task] = field(default_factory=deque)
    lane: int = -1  # of the last task that it was given

    def last_words(self) -> str:
        """The last line that it has written."""
        self.errors.seek(0)
        lines = self.errors.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else ""


def start_process(definition: bytes, gl: str | None) -> WorkerProcess:
    """Start one with a pickled definition; `gl` is MuJoCo's backend for drawing."""
    mine, its = socket.socketpair()
    errors = tempfile.TemporaryFile()  # noqa: SIM115 (as long as the process)
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    environment = (
        os.environ
        | threads
        | ({"MUJOCO_GL": gl} if gl else {})
        | {"PYTHONPATH": os.pathsep.join(path or "." for path in sys.path)}
    )
    process = subprocess.Popen(
        [sys.executable, "-m", "p2l.worlds.gymnasium.worker", str(its.fileno())],
        pass_fds=[its.fileno()], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=errors, env=environment,
    )  # fmt: skip
    its.close()
    connection = Connection(mine.detach())
    with contextlib.suppress(OSError):  # it has died already; its greeting will tell
        connection.send_bytes(definition)
    return WorkerProcess(process, connection, errors)


def memory_file(size: int) -> int:
    """Descriptor of memory that processes can share, `size` bytes."""
    if hasattr(os, "memfd_create"):
        file = os.memfd_create("p2l-rows")
    else:
        with tempfile.TemporaryFile() as temporary:
            file = os.dup(temporary.fileno())
    os.ftruncate(file, size)
    return file


def end_processes(workers: list[WorkerProcess], file: int | None) -> None:
    """Let them end, and close the memory."""
    for worker in workers:
        worker.connection.close()
    for worker in workers:
        try:
            worker.process.wait(timeout=5)
        except subprocess.TimeoutExpired:
            worker.process.kill()
            worker.process.wait()
        worker.errors.close()
    if file is not None:
        os.close(file)

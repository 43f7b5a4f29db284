"""The process of one environment: `python -m p2l.worlds.gymnasium.worker <file descriptor of a socket>`.

It is told a definition, then jobs. Rows come and go through memory that it shares with its parent, two places per lane:
one that the parent writes, one that this process writes. A row that some process has left there need not be brought
back by the parent. Only small messages go through the socket.
"""

from __future__ import annotations

import gc
import mmap
import os
import signal
import socket
import sys
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

import cloudpickle
import numpy as np

from p2l.errors import P2LError, ShapeError
from p2l.records import Array
from p2l.worlds.gymnasium.check import facts_of
from p2l.worlds.gymnasium.jobs import Moment, OptionJob
from p2l.worlds.gymnasium.simulation import Simulation

_ALIGN = 64
IS_THERE, FROM_PARENT, FROM_WORKER = range(3)  # where a job's row is: in the environment, or in which of its places


@dataclass(frozen=True)
class Lanes:
    """Places of rows in shared memory.

    Attributes:
        count: of lanes.
        state_bytes: of a row's state.
        sensed: numbers of what a row has sensed.
    """

    count: int
    state_bytes: int
    sensed: int

    @property
    def row_bytes(self) -> int:
        """Of one row."""
        return -(-(self.state_bytes + 8 * self.sensed) // _ALIGN) * _ALIGN

    @property
    def size(self) -> int:
        """Of the memory."""
        return 2 * self.count * self.row_bytes

    def views(self, memory: mmap.mmap, lane: int, *, of_worker: bool) -> tuple[Any, Array]:
        """The state [state_bytes] and what was sensed [sensed] of a lane, as windows on the memory."""
        start = (2 * lane + of_worker) * self.row_bytes
        state = np.frombuffer(memory, dtype=np.uint8, count=self.state_bytes, offset=start)
        return state, np.frombuffer(memory, dtype=np.float64, count=self.sensed, offset=start + self.state_bytes)


def write_row(state: Any, sensed: Array, moment: Moment) -> None:
    """Put a row into a lane's views.

    Raises:
        ShapeError: its state has outgrown the row.
    """
    size = len(moment.state)
    if size > len(state):
        raise ShapeError(f"the environment's state has grown to {size} bytes; a row holds {len(state)}")
    state[:size] = np.frombuffer(moment.state, dtype=np.uint8)
    state[size:] = 0
    sensed[:] = moment.sensed


def _serve(simulation: Simulation, connection: Connection, memory: mmap.mmap, lanes: Lanes) -> None:
    """Answer jobs until the parent is gone."""
    while True:
        try:
            message = connection.recv()
        except EOFError:
            return
        try:
            answer = _answer(simulation, memory, lanes, *message)
        except P2LError as error:
            connection.send(("error", str(error)))
        else:
            connection.send(("done", answer))


def _answer(
    simulation: Simulation, memory: mmap.mmap, lanes: Lanes, lane: int, what: str, content: Any, place: int
) -> Any:
    answer: Any = None
    if what == "reset":
        simulation.reset(int(content))
    else:
        if place != IS_THERE:
            state, sensed = lanes.views(memory, lane, of_worker=place == FROM_WORKER)
            simulation.put(Moment(memoryview(state), sensed))
        if what == "draw":
            return simulation.draw()
        if what == "copies":
            return simulation.copies
        result = simulation.run(OptionJob.of_plain(content))
        answer = result.to_plain()
        if result.told:
            return answer
    write_row(*lanes.views(memory, lane, of_worker=True), simulation.take())
    return answer


def main(descriptor: int) -> int:
    """Greet, check, serve."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent tells its workers when to end
    channel = socket.socket(fileno=os.dup(descriptor))
    connection = Connection(descriptor)
    definition, is_first = cloudpickle.loads(connection.recv_bytes())
    try:
        simulation = Simulation(definition)
        facts = facts_of(simulation) if is_first else None
    except P2LError as error:
        connection.send(("error", str(error)))
        return P2LError.exit_code
    connection.send(("ready", facts))
    gc.freeze()  # what is there now stays: no search for garbage needs to look at it again
    lanes = connection.recv()
    _, descriptors, _, _ = socket.recv_fds(channel, 1, 1)
    memory = mmap.mmap(descriptors[0], lanes.size)
    os.close(descriptors[0])
    channel.close()
    _serve(simulation, connection, memory, lanes)
    return 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))

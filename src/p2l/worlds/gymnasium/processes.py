"""Environments in processes of their own, which take jobs in turn and never wait for one another.

Jobs are handed out in the order in which they come, and each result is asked for by its ticket, so that what a caller
sees does not depend on which process was faster. A process that dies is replaced; the row that it was working on counts
as diverged.
"""

from __future__ import annotations

import logging
import mmap
import os
import selectors
import socket
import weakref
from collections import deque
from collections.abc import Sequence
from typing import Any

import cloudpickle
import numpy as np

from p2l.errors import ConfigError
from p2l.records import Array, IntArray
from p2l.skills.runner import Reason
from p2l.worlds.gymnasium.check import Facts
from p2l.worlds.gymnasium.jobs import JobResult, Moment, OptionJob
from p2l.worlds.gymnasium.process import Task, WorkerProcess, end_processes, memory_file, start_process
from p2l.worlds.gymnasium.simulation import Definition
from p2l.worlds.gymnasium.worker import FROM_PARENT, FROM_WORKER, IS_THERE, Lanes, write_row

log = logging.getLogger(__name__)

LANES = 1024  # rows that may be at work at once; memory is taken as they are used
PATIENCE_S = 60.0  # without any answer, until a warning says who is at work
_DEPTH = 3  # jobs that wait at a process, so that it never waits for its parent
_ENOUGH = 3  # deaths in a row, with nothing done in between


class Processes:
    """The processes of a world.

    Args:
        name: of the world, for messages.
        definition: of its environment.
        count: of processes.
        facts: of the environment, where they are known; else the first process checks it.
        gl: MuJoCo's backend for drawing, for processes that draw.

    Raises:
        ConfigError: the definition cannot be sent, or its environment does not keep the rules of `check`.
    """

    def __init__(
        self, name: str, definition: Definition, count: int, *, facts: Facts | None = None, gl: str | None = None
    ) -> None:
        self.name, self._gl = name, gl
        self._names = [option.name for option in definition.options]
        try:
            self._definition = cloudpickle.dumps((definition, False))
            first = cloudpickle.dumps((definition, facts is None))
        except Exception as error:
            raise ConfigError(
                f"world '{name}': make_env or one of its functions cannot be sent to a process "
                f"({type(error).__name__}: {error}); make what it needs inside `make_env`"
            ) from error
        begun = [start_process(first, gl), *(start_process(self._definition, gl) for _ in range(count - 1))]
        try:
            for worker in begun:
                greeting = self._greeting(worker)
                facts = facts or greeting
            assert facts is not None
        except BaseException:
            end_processes(begun, None)
            raise
        self.facts = facts
        for remark in facts.remarks:
            log.warning("world '%s': %s", name, remark)
        self.lanes = Lanes(LANES, facts.state_bytes, facts.layout.size + facts.layout.action_size + 2)
        self._file = memory_file(self.lanes.size)
        self._memory = mmap.mmap(self._file, self.lanes.size)
        self._workers = begun
        self._selector = selectors.PollSelector()
        for worker in begun:
            self._share(worker)
        self._waiting: deque[Task] = deque()
        self._results: dict[int, tuple[int, Any]] = {}  # lane and answer, by ticket
        self._tickets = self._deaths = 0
        self._free = list(range(LANES - 1, -1, -1))
        self._given: list[int] = []  # lanes that nobody asks for any more; a process may still be at work for them
        weakref.finalize(self, end_processes, self._workers, self._file)

    def take_lanes(self, count: int) -> IntArray:
        """Lanes [count] for rows.

        Raises:
            ConfigError: there are not so many.
        """
        self._take_back()
        if count > len(self._free):
            raise ConfigError(f"world '{self.name}': {count} slots asked for; {len(self._free)} of {LANES} are free")
        return np.array([self._free.pop() for _ in range(count)], dtype=np.int64)

    def give_lanes(self, lanes: Sequence[int]) -> None:
        """Give lanes back, with jobs that are still at work or not. Python may call it at any moment."""
        self._given += lanes

    def submit(self, lane: int, what: str, content: Any = None, row: Moment | None = None) -> int:
        """A job for the row of a lane, as soon as a process is free; returns its ticket.

        Args:
            lane: whose row.
            what: `reset` (content: a seed), `run` (content: a `OptionJob`) or `draw`.
            content: see `what`.
            row: to start from; None: where the lane's last job has ended.
        """
        if row is not None:
            write_row(*self.lanes.views(self._memory, lane, of_worker=False), row)
            self._forget(lane)
        self._tickets += 1
        self._waiting.append(Task(self._tickets, lane, what, content, goes_on=row is None))
        self._hand_out()
        return self._tickets

    def collect(self, ticket: int) -> Any:
        """What a job has come to; waits for it.

        Raises:
            ConfigError: the environment, or a person's function, has failed.
        """
        while ticket not in self._results:
            self._receive()
        _, answer = self._results.pop(ticket)
        if isinstance(answer, ConfigError):
            raise answer
        return answer

    def row(self, lane: int) -> tuple[Any, Array]:
        """The state [bytes] and what was sensed in a lane by its last job, as windows on the memory."""
        return self.lanes.views(self._memory, lane, of_worker=True)

    @property
    def pids(self) -> list[int]:
        """Of the processes at present."""
        return [worker.process.pid for worker in self._workers]

    def copies(self) -> int:
        """Copies of a whole state that the processes have made so far."""
        total = 0
        for worker in self._workers:
            while worker.tasks:  # of somebody who has gone
                self._receive()
            worker.connection.send((0, "copies", None, IS_THERE))
            total += int(worker.connection.recv()[1])
        return total

    def _hand_out(self) -> None:
        while self._waiting:
            lane = self._waiting[0].lane
            worker = min(self._workers, key=lambda each: (len(each.tasks), each.lane != lane))
            if len(worker.tasks) >= _DEPTH:
                return
            task = self._waiting.popleft()
            is_there = worker.lane == lane or task.what == "reset"
            place = IS_THERE if is_there else FROM_WORKER if task.goes_on else FROM_PARENT
            self._forget(lane)
            worker.lane = lane
            worker.tasks.append(task)
            try:
                content = task.content.to_plain() if isinstance(task.content, OptionJob) else task.content
                worker.connection.send((task.lane, task.what, content, place))
            except OSError:
                self._replace(worker)

    def _take_back(self) -> None:
        """Free the lanes that were given back; jobs of theirs are dropped, and those at work are waited for."""
        lanes, self._given = self._given, []
        given = set(lanes)
        if not given:
            return
        self._waiting = deque(task for task in self._waiting if task.lane not in given)
        while any(task.lane in given for worker in self._workers for task in worker.tasks):
            self._receive()
        self._results = {ticket: kept for ticket, kept in self._results.items() if kept[0] not in given}
        self._free += sorted(given, reverse=True)

    def _forget(self, lane: int) -> None:
        """No process is at the row of this lane any more."""
        for worker in self._workers:
            worker.lane = -1 if worker.lane == lane else worker.lane

    def _receive(self) -> None:
        ready = self._selector.select(PATIENCE_S)
        if not ready:
            busy = [worker for worker in self._workers if worker.tasks]
            log.warning("world '%s': no answer for %d s from %s", self.name, PATIENCE_S, self._at_work(busy))
        for worker in [key.data for key, _ in ready]:
            try:
                status, answer = worker.connection.recv()
            except (EOFError, OSError):
                self._replace(worker)
                continue
            self._deaths = 0
            task = worker.tasks.popleft()
            if status == "error":
                answer = ConfigError(f"world '{self.name}': {answer}")
            elif isinstance(task.content, OptionJob):
                answer = JobResult.of_plain(answer)
            self._results[task.ticket] = task.lane, answer
        self._hand_out()

    def _at_work(self, busy: Sequence[WorkerProcess]) -> str:
        """What processes are at, for a message."""
        jobs = [worker.tasks[0].content for worker in busy]
        names = [self._names[job.option] if isinstance(job, OptionJob) else "a reset or a picture" for job in jobs]
        return ", ".join(f"'{name}'" for name in names)

    def _replace(self, worker: WorkerProcess) -> None:
        """Another process in the place of one that has died."""
        code = worker.process.wait()
        words = worker.last_words()
        told = f"a process died ({f'signal {-code}' if code < 0 else f'exit code {code}: {words}'})"
        self._deaths += 1
        if self._deaths >= _ENOUGH:
            raise ConfigError(f"world '{self.name}': {told}, {self._deaths} times in a row with nothing done")
        log.warning("world '%s': %s; its row counts as diverged, another process takes its place", self.name, told)
        again = list(worker.tasks)
        if again and isinstance(job := again[0].content, OptionJob):
            outcome = JobResult(Reason.DIVERGENCE, 0, job.memory, job.kind, 0, job.muted, 0.0, told)
            task = again.pop(0)
            self._results[task.ticket] = task.lane, outcome
        self._waiting.extendleft(reversed(again))
        fresh = start_process(self._definition, self._gl)
        self._greeting(fresh)
        self._share(fresh)
        self._selector.unregister(worker.connection)
        worker.connection.close()
        self._workers[self._workers.index(worker)] = fresh
        self._hand_out()

    def _greeting(self, worker: WorkerProcess) -> Any:
        try:
            while not worker.connection.poll(PATIENCE_S):
                log.warning("world '%s': making and trying its environment lasts over %d s", self.name, PATIENCE_S)
            status, content = worker.connection.recv()
        except (EOFError, OSError):
            code = worker.process.wait()
            raise ConfigError(
                f"world '{self.name}': a process could not make its environment (exit code {code}: "
                f"{worker.last_words() or 'it said nothing'})"
            ) from None
        if status == "error":
            raise ConfigError(f"world '{self.name}': {content}")
        return content

    def _share(self, worker: WorkerProcess) -> None:
        self._selector.register(worker.connection, selectors.EVENT_READ, worker)
        worker.connection.send(self.lanes)
        with socket.socket(fileno=os.dup(worker.connection.fileno())) as channel:
            socket.send_fds(channel, [b"m"], [self._file])

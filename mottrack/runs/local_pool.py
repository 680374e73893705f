"""A pool of worker processes, one task each; if a worker dies, only its task is lost."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import cast

from mottrack.compiled import compilation_told
from mottrack.core.memory import fitting, warn_when_scarce
from mottrack.core.processes import available_cores, end_with_parent
from mottrack.runs.tasks import (
    DIED,
    THREAD_VARIABLES,
    Job,
    Outcome,
    Progress,
    Task,
    attempt,
    seldom,
)

COMPILING = "compiling"
"""Message of a worker that compiles a function; other messages are tuples and lists."""
WORKER_BYTES = 700 << 20
"""Of a process that runs the largest network: 606 MB resident on sweeps of 20,000 points."""


@dataclass(frozen=True)
class LocalPool:
    """Supervised processes of this machine, with one task each at a time.

    Each process computes with one thread, so that results do not depend on their number.
    """

    workers: int = 0
    """Number of processes; 0: one per core, or as many as fit into the memory."""

    @property
    def slots(self) -> int:
        """Number of processes."""
        return self.workers or fitting(available_cores(), WORKER_BYTES)

    def check(self, scenes: Mapping[Job, tuple[str, ...]]) -> None:
        """Accept: this machine is the one that has planned the work."""

    def run(self, tasks: Sequence[Task], progress: Progress) -> list[Outcome]:
        """Run every task; a process that dies is replaced, and only its task is lost."""
        pool = _Pool(progress, deque(tasks))
        try:
            for _ in range(min(self.slots, len(tasks))):
                pool.start_worker()
            while pool.busy:
                for connection in wait(list(pool.busy)):
                    pool.receive(pool.busy[cast(Connection, connection)])
        finally:
            pool.terminate()
        return [pool.outcomes[folder, task.name] for task in tasks for folder in task.folders]


@dataclass
class _Worker:
    process: SpawnProcess
    connection: Connection
    task: Task | None = None
    served: bool = False
    """Whether it has ended a task."""


@dataclass
class _Pool:
    """Processes that work on one task after the other."""

    progress: Progress
    queue: deque[Task]
    busy: dict[Connection, _Worker] = field(default_factory=dict)
    idle: list[_Worker] = field(default_factory=list)
    outcomes: dict[tuple[Path, str], Outcome] = field(default_factory=dict)

    def start_worker(self) -> None:
        """Start a process and give it a task."""
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=_serve, args=(theirs,), daemon=True)
        with _child_environment():
            process.start()
        theirs.close()
        self._give_task(_Worker(process, ours))

    def receive(self, worker: _Worker) -> None:
        """Receive one message of a worker: its progress, the end of its task, or its death."""
        task = worker.task
        if task is None:
            return
        try:
            message = worker.connection.recv()
        except (EOFError, ConnectionResetError):
            self._retry(worker, task)
            return
        if isinstance(message, list):
            self._end(message)
            worker.served = True
            self._give_task(worker)
        elif message == COMPILING:
            self.progress.compiling()
        else:
            self.progress.advances(task.progress(*message))

    def terminate(self) -> None:
        """Terminate every process, busy or idle."""
        for worker in [*self.busy.values(), *self.idle]:
            worker.process.terminate()
            worker.process.join()

    def _give_task(self, worker: _Worker) -> None:
        self.busy.pop(worker.connection, None)
        worker.task = self.queue.popleft() if self.queue else None
        if worker.task is None:
            self.idle.append(worker)
            return
        self.busy[worker.connection] = worker
        try:
            worker.connection.send(worker.task)
        except (BrokenPipeError, ConnectionResetError):  # it died since its last result
            self._replace(worker, worker.task)

    def _replace(self, worker: _Worker, task: Task) -> None:
        """Give the task of a worker that died before it received it to another one.

        If not even its first task was received, that is a death of the task: one that can't be
        sent would be tried for ever.
        """
        if not worker.served:
            self._retry(worker, task)
            return
        del self.busy[worker.connection]
        worker.process.join()
        self.queue.appendleft(task)
        self.start_worker()

    def _retry(self, worker: _Worker, task: Task) -> None:
        """Queue the task of a dead worker again, unless it was the last attempt."""
        del self.busy[worker.connection]
        worker.process.join()
        again = task.after_death()
        self.queue.extend(again)
        if not again:
            self._end(task.failed(DIED))
        if self.queue:
            self.start_worker()

    def _end(self, outcomes: list[Outcome]) -> None:
        for outcome in outcomes:
            self.outcomes[outcome.folder, outcome.name] = outcome
            self.progress.ends(outcome)


def _serve(connection: Connection) -> None:
    """Work on one task after the other until the parent closes the connection."""

    def tell(done: int, total: int) -> None:
        connection.send((done, total))

    on_step = seldom(tell)
    end_with_parent()
    warn_when_scarce()
    with compilation_told(lambda: connection.send(COMPILING)):
        while True:
            try:
                connection.send(attempt(connection.recv(), on_step))
            except (EOFError, BrokenPipeError, ConnectionResetError):
                return  # the parent has ended


@contextmanager
def _child_environment() -> Iterator[None]:
    """Start child processes within the block with one thread each and with SIGINT blocked.

    Ctrl-C is handled by the parent, which terminates them.
    """
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    # starting the tracker unblocks SIGINT, so it has to run before SIGINT is blocked
    resource_tracker.ensure_running()
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value

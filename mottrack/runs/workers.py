"""A pool of worker processes, one scene each; if a worker dies, only its scene is lost."""

from __future__ import annotations

import multiprocessing
import os
import signal
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Protocol, cast

from mottrack.core.errors import MottrackError
from mottrack.core.processes import end_with_parent
from mottrack.experiment.experiment import Experiment

Key = tuple[Path, str]
OnFrame = Callable[[int, int], None]
ATTEMPTS = 2
"""Per scene: a worker may be killed for lack of memory while another one peaks."""
FRAMES_PER_MESSAGE = 10
"""Frames between two messages of progress: about one a second, so that pipes stay idle."""
THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)


@dataclass(frozen=True)
class Task:
    """One scene of one experiment."""

    experiment: Experiment
    scene: str
    folder: Path

    @property
    def key(self) -> Key:
        """Identity of the task: every run may have a scene of that name."""
        return self.folder, self.scene


@dataclass(frozen=True)
class Outcome:
    """End of a task; an empty error means that its result is stored."""

    scene: str
    error: str = ""
    folder: Path = Path()


class Progress(Protocol):
    """Receives the progress of the work."""

    def begin(self, title: str, scenes: int, todo: int) -> None:
        """Start a run of ``scenes`` scenes, of which ``todo`` have no result yet."""
        ...

    def frames(self, scene: str, done: int, total: int) -> None:
        """Report the frames of a scene that are done."""
        ...

    def scene_ends(self, outcome: Outcome) -> None:
        """Report a scene that is finished or has failed."""
        ...


Work = Callable[[Task, OnFrame], None]
DIED = "its process died (killed, out of memory, or a crash in a library)"


@dataclass
class _Worker:
    process: SpawnProcess
    connection: Connection
    task: Task | None = None


def run_tasks(
    tasks: Sequence[Task], work: Work, *, workers: int, progress: Progress
) -> list[Outcome]:
    """Run every task in one of ``workers`` processes.

    Each process computes with one thread, so that results do not depend on their number. A task
    that raises fails at once; one whose process dies is tried once more, in a new process.

    Returns:
        The outcomes in the order of the tasks.
    """
    pool = _Pool(work, progress, deque(tasks))
    try:
        for _ in range(min(max(workers, 1), len(tasks))):
            pool.start_worker()
        while pool.busy:
            for connection in wait(list(pool.busy)):
                pool.receive(pool.busy[cast(Connection, connection)])
    finally:
        pool.terminate()
    return [pool.outcomes[task.key] for task in tasks]


@dataclass
class _Pool:
    """Processes that work on one task after the other."""

    work: Work
    progress: Progress
    queue: deque[Task]
    busy: dict[Connection, _Worker] = field(default_factory=dict)
    idle: list[_Worker] = field(default_factory=list)
    outcomes: dict[Key, Outcome] = field(default_factory=dict)
    deaths: Counter[Key] = field(default_factory=Counter)

    def start_worker(self) -> None:
        """Start a process and give it a task."""
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=_serve, args=(theirs, self.work), daemon=True)
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
        if isinstance(message, Outcome):
            self._end(message)
            self._give_task(worker)
        else:
            self.progress.frames(task.scene, *message)

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
        worker.connection.send(worker.task)

    def _retry(self, worker: _Worker, task: Task) -> None:
        """Queue the task of a dead worker again, unless it was the last attempt."""
        del self.busy[worker.connection]
        worker.process.join()
        self.deaths[task.key] += 1
        if self.deaths[task.key] < ATTEMPTS:
            self.queue.append(task)
        else:
            self._end(Outcome(task.scene, DIED, task.folder))
        if self.queue:
            self.start_worker()

    def _end(self, outcome: Outcome) -> None:
        self.outcomes[outcome.folder, outcome.scene] = outcome
        self.progress.scene_ends(outcome)


def _serve(connection: Connection, work: Work) -> None:
    """Work on one task after the other until the parent closes the connection."""

    def on_frame(done: int, total: int) -> None:
        if done % FRAMES_PER_MESSAGE == 0 or done == total:
            connection.send((done, total))

    end_with_parent()
    while True:
        try:
            connection.send(_outcome(connection.recv(), work, on_frame))
        except (EOFError, BrokenPipeError, ConnectionResetError):
            return  # the parent has ended


def _outcome(task: Task, work: Work, on_frame: OnFrame) -> Outcome:
    try:
        work(task, on_frame)
    except (BrokenPipeError, ConnectionResetError):
        raise
    except MottrackError as error:
        return Outcome(task.scene, str(error), task.folder)
    except Exception as error:  # noqa: BLE001 - only this scene fails, whatever the error
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(place.filename).name}:{place.lineno}"
        return Outcome(task.scene, f"{type(error).__name__}: {error} ({where})", task.folder)
    return Outcome(task.scene, folder=task.folder)


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

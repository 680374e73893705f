"""Processes that each run one scene at a time; when one dies, only its scene is lost."""

from __future__ import annotations

import multiprocessing
import os
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnContext, SpawnProcess
from pathlib import Path
from typing import Protocol

from mottrack.core.errors import MottrackError
from mottrack.pipeline.experiment import Experiment

OnFrame = Callable[[int, int], None]
ATTEMPTS = 2  # a worker that is killed from outside gets its scene a second chance
FRAMES_A_MESSAGE = 10
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


@dataclass(frozen=True)
class Outcome:
    """What became of a task; an empty error means that its result is stored."""

    scene: str
    error: str = ""


class Progress(Protocol):
    """Is told how the work goes on."""

    def begin(self, title: str, scenes: int, todo: int) -> None:
        """A run starts: so many scenes in all, so many still to do."""
        ...

    def frames(self, scene: str, done: int, total: int) -> None:
        """A scene has got that far."""
        ...

    def scene_ends(self, outcome: Outcome) -> None:
        """A scene is finished or has failed."""
        ...


@dataclass
class _Worker:
    process: SpawnProcess
    connection: Connection
    task: Task
    attempt: int


Work = Callable[[Task, OnFrame], None]


def run_tasks(
    tasks: Sequence[Task], work: Work, *, workers: int, progress: Progress
) -> list[Outcome]:
    """Runs every task in processes of their own, at most ``workers`` at a time.

    Each process computes with one thread, so that results do not depend on how many there are.
    A task that raises fails at once; one whose process dies is tried twice.

    Returns:
        The outcomes in the order of the tasks.
    """
    queue = deque((task, 1) for task in tasks)
    running: dict[Connection, _Worker] = {}
    outcomes: dict[str, Outcome] = {}
    context = multiprocessing.get_context("spawn")
    try:
        while queue or running:
            while queue and len(running) < max(workers, 1):
                worker = _start(context, work, *queue.popleft())
                running[worker.connection] = worker
            for connection in wait(list(running)):
                worker = running[connection]  # type: ignore[index]
                outcome = _listen(worker, progress)
                if outcome is None:
                    continue
                del running[worker.connection]
                worker.process.join()
                if outcome.error == DIED and worker.attempt < ATTEMPTS:
                    queue.append((worker.task, worker.attempt + 1))
                    continue
                outcomes[outcome.scene] = outcome
                progress.scene_ends(outcome)
    finally:
        for worker in running.values():
            worker.process.terminate()
    return [outcomes[task.scene] for task in tasks]


DIED = "its process died (killed, out of memory, or a crash in a library)"


def available_cores() -> int:
    """How many processes can work at once here."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _start(context: SpawnContext, work: Work, task: Task, attempt: int) -> _Worker:
    ours, theirs = context.Pipe()
    process = context.Process(target=_work_in_process, args=(theirs, work, task), daemon=True)
    with _one_thread():
        process.start()
    theirs.close()
    return _Worker(process, ours, task, attempt)


def _listen(worker: _Worker, progress: Progress) -> Outcome | None:
    """Takes one message of a worker; an outcome ends its task."""
    try:
        message = worker.connection.recv()
    except (EOFError, ConnectionResetError):
        return Outcome(worker.task.scene, DIED)
    if isinstance(message, Outcome):
        return message
    progress.frames(worker.task.scene, *message)
    return None


def _work_in_process(connection: Connection, work: Work, task: Task) -> None:
    def on_frame(done: int, total: int) -> None:
        if done % FRAMES_A_MESSAGE == 0 or done == total:
            connection.send((done, total))

    try:
        work(task, on_frame)
        outcome = Outcome(task.scene)
    except MottrackError as error:
        outcome = Outcome(task.scene, str(error))
    except Exception as error:  # noqa: BLE001 - the scene fails, whatever it was; the others go on
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(place.filename).name}:{place.lineno}"
        outcome = Outcome(task.scene, f"{type(error).__name__}: {error} ({where})")
    connection.send(outcome)
    connection.close()


@contextmanager
def _one_thread() -> Iterator[None]:
    """Child processes started inside compute with one thread each."""
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value

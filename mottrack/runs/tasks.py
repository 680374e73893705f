"""Tasks, their outcomes, and what executes them: one scene each, or one shard of examples."""

from __future__ import annotations

import time
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple, Protocol, Self

from mottrack.core.errors import MottrackError
from mottrack.core.memory import exhausted

OnStep = Callable[[int, int], None]
"""Receives how many steps of a task are done, and of how many: frames, or examples."""
ATTEMPTS = 2
"""Per task: a worker may be killed for lack of memory while another one peaks."""
MESSAGE_EVERY_S = 0.2
"""Between two messages of progress of a task: as often as an eye follows."""
DIED = (
    "its process died: killed, perhaps by the kernel for want of memory (use fewer --workers), "
    "or a crash in a library"
)
THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)
"""Set to 1 in every worker: results must not depend on how many threads a library opens."""


class Job(Protocol):
    """What tasks belong to: a run of an experiment, or a set of training examples."""

    @property
    def path(self) -> Path:
        """Return the folder of its results."""
        ...

    def fingerprint(self) -> Mapping[str, str]:
        """Return what decides its results beside the data, by name: code, weights and the like.

        Raises:
            DataError: a file is missing.
        """
        ...

    def scenes(self) -> tuple[str, ...]:
        """Return the scenes that it takes from its data set; none where it has none.

        Raises:
            ConfigError: the data set lacks one.
        """
        ...


@dataclass(frozen=True)
class Outcome:
    """End of a task for one of its folders; an empty error means that its result is stored."""

    name: str
    """Of the task."""
    error: str = ""
    folder: Path = Path()


class TaskProgress(NamedTuple):
    """How far one task has got."""

    name: str
    folders: tuple[Path, ...]
    """Of the runs that go through it together."""
    done: int
    """Steps: frames of a scene, examples of a shard."""
    total: int
    node: str = ""
    """On a cluster, where it runs."""


@dataclass(frozen=True)
class Task(ABC):
    """What a worker does at a time. It stores a result in each of its folders."""

    name: str
    """Unlike those of the other tasks with a folder of its own."""
    deaths: int = field(default=0, kw_only=True)
    """How many workers have died of it."""

    @property
    @abstractmethod
    def folders(self) -> tuple[Path, ...]:
        """Folders of the results, one for each outcome."""

    @abstractmethod
    def work(self, on_step: OnStep) -> list[Outcome]:
        """Do the work and store the results; return an outcome for each folder."""

    @abstractmethod
    def stored_in(self, folders: Sequence[Path]) -> Self:
        """Return the same task with other folders for its results."""

    @abstractmethod
    def files(self, folder: Path) -> dict[str, bytes]:
        """Read what it has stored in one of its folders: contents by path within the folder.

        What marks the result finished comes last.
        """

    def parts(self) -> Sequence[Self]:
        """Return what is tried one by one after a worker died: one's crash is not another's."""
        return [self]

    def progress(self, done: int, total: int, node: str = "") -> TaskProgress:
        """Return how far it has got."""
        return TaskProgress(self.name, self.folders, done, total, node)

    def failed(self, error: str) -> list[Outcome]:
        """Return the outcomes where none can end otherwise."""
        return [Outcome(self.name, error, folder) for folder in self.folders]

    def after_death(self) -> list[Self]:
        """Return what is tried after its worker died; nothing after the last try."""
        if self.deaths + 1 >= ATTEMPTS:
            return []
        return [replace(part, deaths=self.deaths + 1) for part in self.parts()]


class Progress(Protocol):
    """Receives the progress of the work."""

    def begin(self, title: str, tasks: int, todo: int) -> None:
        """Start a job of ``tasks`` scenes or shards, of which ``todo`` have no result yet."""
        ...

    def advances(self, progress: TaskProgress) -> None:
        """Report how far a task has got."""
        ...

    def compiling(self) -> None:
        """Report that a process of this machine compiles a function."""
        ...

    def ends(self, outcome: Outcome) -> None:
        """Report a task that is finished or has failed."""
        ...


class Executor(Protocol):
    """Executes tasks: in processes of this machine, or on a cluster."""

    @property
    def slots(self) -> int:
        """How many tasks can run at once."""
        ...

    def check(self, scenes: Mapping[Job, tuple[str, ...]]) -> None:
        """Check, before the work, that every machine can do it.

        Args:
            scenes: each job to the scenes that its data set must have.

        Raises:
            ConfigError: a machine has other code, other weights or other scenes.
            DataError: a machine lacks a file.
        """
        ...

    def run(self, tasks: Sequence[Task], progress: Progress) -> list[Outcome]:
        """Run every task; return an outcome for each of its folders, in the order of the tasks.

        A task that raises fails at once; one whose worker dies is tried once more.
        """
        ...


def seldom(tell: OnStep) -> OnStep:
    """Return a receiver that passes on the last step, and others at most every 0.2 s."""
    next_s = 0.0

    def on_step(done: int, total: int) -> None:
        nonlocal next_s
        if done == total or time.monotonic() >= next_s:
            next_s = time.monotonic() + MESSAGE_EVERY_S
            tell(done, total)

    return on_step


def reason(error: Exception) -> str:
    """Return the reason of a failure in one line; the place too where it is no user's error."""
    if isinstance(error, MottrackError):
        return str(error)
    if isinstance(error, MemoryError):
        return exhausted()
    place = traceback.extract_tb(error.__traceback__)[-1]
    where = f"{Path(place.filename).name}:{place.lineno}"
    return f"{type(error).__name__}: {error} ({where})"


def attempt(task: Task, on_step: OnStep) -> list[Outcome]:
    """Work on a task; turn an error that is nobody's into one of all its folders."""
    try:
        return task.work(on_step)
    except (BrokenPipeError, ConnectionResetError):  # the driver has ended, not the task
        raise
    except Exception as error:  # noqa: BLE001 - only this task fails, whatever the error
        return task.failed(reason(error))

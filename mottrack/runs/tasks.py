"""Tasks, their outcomes, and what executes them: one scene each, for one run or several."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, Protocol

from mottrack.core.errors import MottrackError
from mottrack.core.memory import exhausted
from mottrack.experiment.experiment import Experiment
from mottrack.pipeline.flow_cache import FlowCache
from mottrack.runs.run_folder import RunFolder

OnFrame = Callable[[int, int], None]
ATTEMPTS = 2
"""Per scene: a worker may be killed for lack of memory while another one peaks."""
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


@dataclass(frozen=True, eq=False)
class Job:
    """An experiment and the folder of its results; two of them are the same if one object."""

    experiment: Experiment
    folder: RunFolder


@dataclass(frozen=True)
class Outcome:
    """End of one scene of one run; an empty error means that its result is stored."""

    scene: str
    error: str = ""
    folder: Path = Path()


class FramesDone(NamedTuple):
    """How far one scene has got."""

    scene: str
    folders: tuple[Path, ...]
    """Of the runs that go through it together."""
    done: int
    total: int
    node: str = ""
    """On a cluster, where it runs."""


@dataclass(frozen=True)
class Task:
    """One scene, for one run or for several that share its sweeps."""

    scene: str
    jobs: tuple[Job, ...]
    deaths: int = 0
    """How many workers have died of it."""
    cache: FlowCache | None = None
    """Flow fields that are kept between runs; None: none."""

    def frames(self, done: int, total: int, node: str = "") -> FramesDone:
        """Return how far the scene has got."""
        return FramesDone(
            self.scene, tuple(job.folder.path for job in self.jobs), done, total, node
        )

    def failed(self, error: str) -> list[Outcome]:
        """Return the outcomes of all its runs where none can end otherwise."""
        return [Outcome(self.scene, error, job.folder.path) for job in self.jobs]

    def after_death(self) -> list[Task]:
        """Return what is tried after its worker died: each run alone; nothing after the last try.

        The crash of one run is thus not that of the others.
        """
        if self.deaths + 1 >= ATTEMPTS:
            return []
        return [replace(self, jobs=(job,), deaths=self.deaths + 1) for job in self.jobs]


Work = Callable[[Task, OnFrame], list[Outcome]]
"""Runs a task and stores its results. It returns an outcome for each of the task's runs."""


class Progress(Protocol):
    """Receives the progress of the work."""

    def begin(self, title: str, scenes: int, todo: int) -> None:
        """Start a run of ``scenes`` scenes, of which ``todo`` have no result yet."""
        ...

    def frames(self, done: FramesDone) -> None:
        """Report the frames of a scene that are done."""
        ...

    def compiling(self) -> None:
        """Report that a process of this machine compiles a function."""
        ...

    def scene_ends(self, outcome: Outcome) -> None:
        """Report a scene that is finished or has failed."""
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

    def run(self, tasks: Sequence[Task], work: Work, progress: Progress) -> list[Outcome]:
        """Run every task; return an outcome for each of its runs, in the order of the tasks.

        A task that raises fails at once; one whose worker dies is tried once more.
        """
        ...


def seldom(tell: OnFrame) -> OnFrame:
    """Return a receiver that passes on the last frame, and others at most every 0.2 s."""
    next_s = 0.0

    def on_frame(done: int, total: int) -> None:
        nonlocal next_s
        if done == total or time.monotonic() >= next_s:
            next_s = time.monotonic() + MESSAGE_EVERY_S
            tell(done, total)

    return on_frame


def reason(error: Exception) -> str:
    """Return the reason of a failure in one line; the place too where it is no user's error."""
    if isinstance(error, MottrackError):
        return str(error)
    if isinstance(error, MemoryError):
        return exhausted()
    place = traceback.extract_tb(error.__traceback__)[-1]
    where = f"{Path(place.filename).name}:{place.lineno}"
    return f"{type(error).__name__}: {error} ({where})"


def attempt(work: Work, task: Task, on_frame: OnFrame) -> list[Outcome]:
    """Work on a task; turn an error that is nobody's into one of all its runs."""
    try:
        return work(task, on_frame)
    except (BrokenPipeError, ConnectionResetError):  # the driver has ended, not the task
        raise
    except Exception as error:  # noqa: BLE001 - only this scene fails, whatever the error
        return task.failed(reason(error))

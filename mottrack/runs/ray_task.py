"""What runs on the nodes of a Ray cluster: tasks, the check of a node, the board of progress."""

from __future__ import annotations

import resource
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from mottrack.runs.node_check import Requirements, node_name
from mottrack.runs.run_folder import RunFolder
from mottrack.runs.tasks import FramesDone, Outcome, Task, Work, attempt, seldom


class Done(NamedTuple):
    """What a task returns to the driver."""

    outcomes: list[Outcome]
    files: Sequence[Mapping[str, bytes]]
    """Per finished run its files; none where the task has written them."""
    peak_bytes: int
    """Of the worker, so far."""


class Board:
    """An actor that gathers the progress of all tasks."""

    def __init__(self) -> None:
        self._last: dict[tuple[str, tuple[Path, ...]], FramesDone] = {}

    def tell(self, done: FramesDone) -> None:
        """Note how many frames of a scene are done."""
        self._last[done.scene, done.folders] = done

    def drain(self) -> list[FramesDone]:
        """Return what is new."""
        last, self._last = self._last, {}
        return list(last.values())


class Needs(NamedTuple):
    """What a node must have in common with the driver."""

    requirements: Any
    """Reference of the `Requirements`."""
    checked: frozenset[str]
    """Nodes that have it; others have joined since."""


class Place(NamedTuple):
    """What a task is told about its surroundings."""

    needs: Needs
    board: Any
    store: bool
    """Whether the task writes its results itself."""


def unmet_here(requirements: Requirements) -> tuple[str, str]:
    """Return this node's name, and what it lacks or nothing."""
    return _here(), requirements.unmet()


def _late(needs: Needs) -> str:
    """Return what this node lacks, if it has joined after the check."""
    import ray

    if ray.get_runtime_context().get_node_id() in needs.checked:
        return ""
    requirements: Requirements = ray.get(needs.requirements)
    return replace(requirements, token=None).unmet()


def _here() -> str:
    import ray

    return node_name(ray.get_runtime_context().get_node_id())


def run_task(task: Task, work: Work, place: Place) -> Done:
    """Run a task on a node: store its results there, or return their files."""
    node, unmet = _here(), _late(place.needs)
    if unmet:
        return Done(task.failed(f"node {node}: {unmet}"), [], 0)

    def tell(done: int, total: int) -> None:
        place.board.tell.remote(task.frames(done, total, node))

    on_frame = seldom(tell)
    if place.store:
        return Done(attempt(work, task, on_frame), [], _peak_bytes())
    with tempfile.TemporaryDirectory() as name:
        folders = [RunFolder(Path(name) / str(k)) for k in range(len(task.jobs))]
        jobs = zip(task.jobs, folders, strict=True)
        inside = replace(task, jobs=tuple(replace(job, folder=f) for job, f in jobs))
        found = attempt(work, inside, on_frame)
        files = [RunFolder(o.folder).files(o.scene) for o in found if not o.error]
    own = zip(found, task.jobs, strict=True)
    outcomes = [replace(outcome, folder=job.folder.path) for outcome, job in own]
    return Done(outcomes, files, _peak_bytes())


def _peak_bytes() -> int:
    """Return the largest resident size of this worker so far."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak

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
from mottrack.runs.tasks import Outcome, Task, TaskProgress, attempt, seldom


class Done(NamedTuple):
    """What a task returns to the driver."""

    outcomes: list[Outcome]
    files: Sequence[Mapping[str, bytes]]
    """Of each outcome without an error, contents by path within its folder; none where the task
    has written them."""
    peak_bytes: int
    """Of the worker, so far."""


class Board:
    """An actor that gathers the progress of all tasks."""

    def __init__(self) -> None:
        self._last: dict[tuple[str, tuple[Path, ...]], TaskProgress] = {}

    def tell(self, progress: TaskProgress) -> None:
        """Note how far a task has got."""
        self._last[progress.name, progress.folders] = progress

    def drain(self) -> list[TaskProgress]:
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
    folders: tuple[Path, ...] | None
    """Where the task stores its results; None: it returns them."""


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


def run_task(task: Task, place: Place) -> Done:
    """Run a task on a node: store its results there, or return their files."""
    node, unmet = _here(), _late(place.needs)
    if unmet:
        return Done(task.failed(f"node {node}: {unmet}"), [], 0)

    def tell(done: int, total: int) -> None:
        place.board.tell.remote(task.progress(done, total, node))

    on_step = seldom(tell)
    if place.folders is not None:
        found = attempt(task.stored_in(place.folders), on_step)
        return Done(_of(task, found), [], _peak_bytes())
    with tempfile.TemporaryDirectory() as name:
        inside = task.stored_in([Path(name) / str(k) for k in range(len(task.folders))])
        found = attempt(inside, on_step)
        files = [inside.files(outcome.folder) for outcome in found if not outcome.error]
    return Done(_of(task, found), files, _peak_bytes())


def _of(task: Task, found: Sequence[Outcome]) -> list[Outcome]:
    """Return the outcomes with the folders that the driver knows."""
    own = zip(found, task.folders, strict=True)
    return [replace(outcome, folder=folder) for outcome, folder in own]


def _peak_bytes() -> int:
    """Return the largest resident size of this worker so far."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak

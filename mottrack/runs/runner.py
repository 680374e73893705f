"""Run the scenes of experiments in supervised processes; resume interrupted runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import zip_longest

from mottrack.core.errors import ConfigError
from mottrack.experiment.experiment import Experiment
from mottrack.pipeline.scene_run import run_scene
from mottrack.runs.run_folder import RunFolder
from mottrack.runs.workers import Outcome, Progress, Task, run_tasks


@dataclass(frozen=True)
class Job:
    """An experiment and the folder of its results."""

    experiment: Experiment
    folder: RunFolder


@dataclass(frozen=True)
class RunReport:
    """Finished and failed scenes of a run."""

    finished: tuple[str, ...]
    failed: dict[str, str]
    """Scene to the reason, one line each."""
    resumed: int
    """Number of finished scenes that an earlier run had stored."""


def run_experiment(
    experiment: Experiment, folder: RunFolder, *, workers: int, progress: Progress
) -> RunReport:
    """Run every scene that has no result yet; a failure does not affect the others.

    Raises:
        ConfigError: as `run_jobs`.
    """
    return run_jobs([Job(experiment, folder)], workers=workers, progress=progress)[0]


def run_jobs(
    jobs: Sequence[Job], *, workers: int, progress: Progress, title: str = ""
) -> list[RunReport]:
    """Run several experiments in one pool: none waits for another's last scene.

    They alternate scene by scene: what slows the machine for a while slows them all alike.

    Raises:
        ConfigError: a scene is unknown, or a folder belongs to another configuration, other code
            or other weights.
    """
    scenes = [scene_names(job.experiment) for job in jobs]
    for job in jobs:
        job.folder.reserve(job.experiment)
    todo = (
        [Task(job.experiment, s, job.folder.path) for s in names if not job.folder.finished(s)]
        for job, names in zip(jobs, scenes, strict=True)
    )
    tasks = [task for turn in zip_longest(*todo) for task in turn if task is not None]
    progress.begin(title or _title(jobs), sum(map(len, scenes)), len(tasks))
    try:
        outcomes = run_tasks(tasks, scene_task, workers=workers, progress=progress)
    finally:
        for job in jobs:
            job.folder.remove_partial()
    return [
        _report(names, [o for o in outcomes if o.folder == job.folder.path])
        for job, names in zip(jobs, scenes, strict=True)
    ]


def _report(scenes: tuple[str, ...], outcomes: list[Outcome]) -> RunReport:
    failed = {o.scene: o.error for o in outcomes if o.error}
    finished = tuple(scene for scene in scenes if scene not in failed)
    return RunReport(finished, failed, len(scenes) - len(outcomes))


def _title(jobs: Sequence[Job]) -> str:
    first = jobs[0].experiment
    if len(jobs) == 1:
        return first.variant or first.settings.name
    return f"{first.settings.name}, {len(jobs)} runs".lstrip(", ")


def scene_names(experiment: Experiment) -> tuple[str, ...]:
    """Return the scenes that the experiment asks for, in the data set's order.

    Raises:
        ConfigError: the data set has no scene, or not one that is asked for.
    """
    dataset = experiment.dataset.make()
    known: Sequence[str] = dataset.scene_names
    wanted = experiment.settings.scenes
    if wanted is None:
        if not known:
            raise ConfigError(f"data set '{dataset.name}' has no scene")
        return tuple(known)
    for scene in wanted:
        if scene not in known:
            dataset.scene(scene)  # a data set may open scenes that it does not list; else it raises
    return tuple(wanted)


def scene_task(task: Task, on_frame: Callable[[int, int], None]) -> None:
    """Run one scene and store its result: the work of a worker process."""
    experiment = task.experiment
    dataset = experiment.dataset.make()
    kept = (experiment.settings.scenes or dataset.scene_names)[
        : experiment.settings.snapshots.scenes
    ]
    run = run_scene(
        experiment, dataset.scene(task.scene), on_frame, keep_snapshots=task.scene in kept
    )
    RunFolder(task.folder).store(run)

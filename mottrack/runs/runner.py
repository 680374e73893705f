"""Run the scenes of experiments by an executor; resume interrupted runs."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from itertools import chain, zip_longest
from pathlib import Path

from mottrack.core.errors import ConfigError
from mottrack.core.interfaces import FlowSource
from mottrack.experiment.experiment import Experiment
from mottrack.pipeline.flow_cache import CachedFlow, FlowCache, StaleEntryError
from mottrack.pipeline.scene_run import Member, SceneRun, as_text, flow_identity, run_together
from mottrack.pipeline.stream import make_flow
from mottrack.runs.fingerprint import code_and_weights, fingerprint
from mottrack.runs.local_pool import LocalPool
from mottrack.runs.lock import only_driver
from mottrack.runs.run_folder import RunFolder
from mottrack.runs.shard import Shard, ShardRecord, write_record
from mottrack.runs.tasks import Executor, Job, OnStep, Outcome, Progress, Task, reason

TASKS_PER_SLOT = 2
"""Of tasks that take several runs at once: with fewer, some processes would end long before
others."""


@dataclass(frozen=True)
class Execution:
    """How runs are executed; it changes neither their results nor their bytes."""

    executor: Executor = field(default_factory=LocalPool)
    shard: Shard = field(default_factory=Shard)
    share: bool = True
    """Whether runs on the same scene share its sweeps, flow and objects."""
    cache: FlowCache | None = None
    """Flow fields that are kept between runs; None: none."""


@dataclass(frozen=True, eq=False)
class RunJob:
    """An experiment and the folder of its results; two of them are the same if one object."""

    experiment: Experiment
    folder: RunFolder

    @property
    def path(self) -> Path:
        """Return the path of the folder."""
        return self.folder.path

    def fingerprint(self) -> dict[str, str]:
        """Return configuration, version, code and weights.

        Raises:
            DataError: a file of weights is missing.
        """
        return fingerprint(self.experiment)

    def scenes(self) -> tuple[str, ...]:
        """Return the scenes that the experiment asks for.

        Raises:
            ConfigError: as `scene_names`.
        """
        return scene_names(self.experiment)


@dataclass(frozen=True)
class SceneTask(Task):
    """One scene, for one run or for several that share its sweeps."""

    jobs: tuple[RunJob, ...]
    cache: FlowCache | None = None
    """Flow fields that are kept between runs; None: none."""

    @property
    def folders(self) -> tuple[Path, ...]:
        """Folders of the runs."""
        return tuple(job.path for job in self.jobs)

    def work(self, on_step: OnStep) -> list[Outcome]:
        """Run the scene for each of the runs and store the results."""
        outcomes = []
        for job, run in zip(self.jobs, run_scene_of(self, on_step), strict=True):
            if isinstance(run, Exception):
                outcomes.append(Outcome(self.name, reason(run), job.path))
            else:
                job.folder.store(run)
                outcomes.append(Outcome(self.name, folder=job.path))
        return outcomes

    def stored_in(self, folders: Sequence[Path]) -> SceneTask:
        """Return the same scene for runs in other folders."""
        moved = zip(self.jobs, folders, strict=True)
        return replace(self, jobs=tuple(RunJob(job.experiment, RunFolder(f)) for job, f in moved))

    def files(self, folder: Path) -> dict[str, bytes]:
        """Read the files of the scene in the folder of a run."""
        return RunFolder(folder).files(self.name)

    def parts(self) -> list[SceneTask]:
        """Return a task for each of the runs."""
        return [replace(self, jobs=(job,)) for job in self.jobs]


@dataclass(frozen=True)
class RunReport:
    """Finished and failed scenes of a run."""

    finished: tuple[str, ...]
    failed: dict[str, str]
    """Scene to the reason, one line each."""
    resumed: int
    """Number of finished scenes that an earlier run had stored."""


def run_experiment(
    experiment: Experiment, folder: RunFolder, *, execution: Execution, progress: Progress
) -> RunReport:
    """Run every scene that has no result yet; a failure does not affect the others.

    Raises:
        ConfigError: as `run_jobs`.
    """
    return run_jobs([RunJob(experiment, folder)], execution=execution, progress=progress)[0]


def run_jobs(
    jobs: Sequence[RunJob], *, execution: Execution, progress: Progress, title: str = ""
) -> list[RunReport]:
    """Run several experiments together: none waits for another's last scene.

    They alternate scene by scene: what slows the machine for a while slows them all alike.

    Raises:
        ConfigError: a scene is unknown, another process works in a folder, or a folder belongs to
            another configuration, other code or other weights.
    """
    names: dict[Job, tuple[str, ...]] = {job: job.scenes() for job in jobs}
    scenes = {job: execution.shard.of(names[job]) for job in jobs}
    with ExitStack() as locks:
        for job in jobs:
            locks.enter_context(only_driver(job.folder.path))
            job.folder.reserve(job.experiment)
        execution.executor.check(names)
        tasks = _tasks(scenes, execution)
        todo = sum(len(task.jobs) for task in tasks)
        progress.begin(title or _title(jobs), sum(map(len, scenes.values())), todo)
        try:
            outcomes = execution.executor.run(tasks, progress)
        finally:
            for job in jobs:
                job.folder.remove_partial()
        reports = [_report(job, scenes[job], outcomes) for job in jobs]
        for row, (job, report) in enumerate(zip(jobs, reports, strict=True)):
            if not execution.shard.whole:
                record = ShardRecord(execution.shard, scenes[job], report.failed, row)
                write_record(job.folder.path, record)
        return reports


def _tasks(scenes: Mapping[RunJob, tuple[str, ...]], execution: Execution) -> list[SceneTask]:
    """Return a task for each scene and set of runs that share it, scene by scene.

    All runs on a data set share its scenes where there are enough of them to occupy every
    process; else those that measure the same flow do.
    """
    if not execution.share:
        return _grouped(scenes, lambda job: str(job.folder.path), execution)
    tasks = _grouped(scenes, _dataset_key, execution)
    if len(tasks) < TASKS_PER_SLOT * execution.executor.slots:
        return _grouped(scenes, _flow_key, execution)
    return tasks


def _grouped(
    scenes: Mapping[RunJob, tuple[str, ...]], key: Callable[[RunJob], str], execution: Execution
) -> list[SceneTask]:
    keys = {job: key(job) for job in scenes}
    todo = (
        [(s, job) for s in names if not job.folder.finished(s)] for job, names in scenes.items()
    )
    groups: dict[tuple[str, str], list[RunJob]] = defaultdict(list)
    for scene, job in filter(None, chain.from_iterable(zip_longest(*todo))):
        groups[scene, keys[job]].append(job)
    return [SceneTask(scene, tuple(jobs), execution.cache) for (scene, _), jobs in groups.items()]


def _dataset_key(job: RunJob) -> str:
    return as_text(job.experiment.dataset.resolved())


def _flow_key(job: RunJob) -> str:
    return _dataset_key(job) + flow_identity(job.experiment)


def _report(job: RunJob, scenes: tuple[str, ...], outcomes: Sequence[Outcome]) -> RunReport:
    own = [outcome for outcome in outcomes if outcome.folder == job.folder.path]
    failed = {outcome.name: outcome.error for outcome in own if outcome.error}
    finished = tuple(scene for scene in scenes if scene not in failed)
    return RunReport(finished, failed, len(scenes) - len(own))


def _title(jobs: Sequence[RunJob]) -> str:
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


def run_scene_of(
    task: SceneTask, on_step: OnStep, *, fresh: bool = False
) -> list[SceneRun | Exception]:
    """Return the results of each of the task's runs, or the errors that ended them.

    Args:
        task: what to run.
        on_step: receives the progress.
        fresh: whether to measure even the flow that is stored.
    """
    dataset = task.jobs[0].experiment.dataset.make()
    members = [_member(job.experiment, task.name, dataset.scene_names) for job in task.jobs]
    flows: list[CachedFlow] = []

    def make(experiment: Experiment) -> FlowSource:
        source = make_flow(experiment)
        if task.cache is None or not source.needs_sweeps:  # nothing that takes time
            return source
        made_with = as_text(code_and_weights([experiment.flow])) + flow_identity(experiment)
        flows.append(CachedFlow(source, made_with, task.cache, fresh))
        return flows[-1]

    runs = run_together(members, dataset.scene(task.name), on_step, make)
    failed = any(isinstance(run, Exception) for run in runs)
    for flow in flows:
        flow.discard() if failed else flow.keep()
    if any(isinstance(run, StaleEntryError) for run in runs):
        return run_scene_of(task, on_step, fresh=True)
    return runs


def _member(experiment: Experiment, scene: str, known: Sequence[str]) -> Member:
    settings = experiment.settings
    return Member(experiment, scene in (settings.scenes or known)[: settings.snapshots.scenes])

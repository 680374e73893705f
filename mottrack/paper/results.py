"""Execution of the studies, with resumption, and resampling of every metric by scene."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.core.processes import available_cores
from mottrack.core.storage import write_text
from mottrack.eval.paired import (
    RESAMPLES,
    MetricKey,
    PairedDifference,
    Pooled,
    Ratio,
    Sampled,
    draw,
    paired,
    sample,
    variance,
)
from mottrack.eval.run_metrics import RunMetrics
from mottrack.paper.claims import Finding, claims, verdict_of
from mottrack.paper.plan import Study
from mottrack.runs.criteria import Judged, judge
from mottrack.runs.differences import Resamples, common_scenes, sample_runs
from mottrack.runs.local_pool import LocalPool
from mottrack.runs.per_scene import PerScene
from mottrack.runs.run_folder import RunFolder
from mottrack.runs.runner import Execution, RunJob, RunReport, run_jobs
from mottrack.runs.scored_run import ScoredRun
from mottrack.runs.tasks import Progress
from mottrack.runs.velocity_bench import FlowValue, flow_values

WARM_UP_FRAMES = 3
"""The first flows of a scene compile and allocate; they are left out of the runtime."""
RUNTIME, BALL = "runtime", "ball"
MACHINE_FILE = "machine.json"


class FailedScene(NamedTuple):
    """A scene of a run that failed."""

    variant: str
    scene: str


@dataclass(frozen=True)
class StudyResult:
    """A study after it has run."""

    study: Study
    sampling: Resamples
    failed: dict[FailedScene, str]
    """Failed scenes to the reason."""
    folders: dict[str, RunFolder]
    """Variant to its results."""
    bench: tuple[FlowValue, ...] = ()
    """What each flow source was worth beside no flow, over common rows."""

    @property
    def judged(self) -> list[Judged]:
        """The criteria of the study's file with their verdicts."""
        return judge(self.study.criteria, self.bench)

    def sampled(self, variant: str, key: MetricKey) -> Sampled | None:
        """Return a metric of one run on all resamples; None where it was not measured."""
        return self.sampling.figures.get(variant, {}).get(key)

    def paired(self, rival: str, subject: str, key: MetricKey) -> PairedDifference | None:
        """Return subject against rival; None where one of them lacks the metric."""
        baseline, run = self.sampled(rival, key), self.sampled(subject, key)
        if baseline is None or run is None:
            return None
        found = paired(key, baseline, run)
        return found if found.difference == found.difference else None


@dataclass(frozen=True)
class Results:
    """All studies."""

    studies: tuple[StudyResult, ...]
    machines: tuple[str, ...] = ()
    """Machines that the runtimes were measured on; several where a run was resumed."""

    def find(self, dataset: str, study: str) -> StudyResult | None:
        """Return one study; None where it was not asked for."""
        found = [s for s in self.studies if (s.study.dataset, s.study.name) == (dataset, study)]
        return found[0] if found else None

    @property
    def datasets(self) -> dict[str, str]:
        """Data set to its title, in order."""
        return {s.study.dataset: s.study.title for s in self.studies}

    @property
    def failed(self) -> dict[str, str]:
        """``study/variant/scene`` of every failed scene to the reason."""
        return {
            f"{s.study.folder}/{failed.variant}/{failed.scene}": reason
            for s in self.studies
            for failed, reason in s.failed.items()
        }

    def findings(self, dataset: str) -> list[Finding]:
        """Test every claim on one data set, except those of studies that could not be run."""
        found = []
        for claim in claims():
            study = self.find(dataset, claim.study)
            if study is not None and not study.study.reason:
                difference = study.paired(claim.rival, claim.subject, claim.key)
                found.append(Finding(claim, dataset, verdict_of(claim, difference), difference))
        return found


def run_studies(
    studies: Sequence[Study], out: Path, *, execution: Execution, progress: Progress
) -> Results:
    """Run every scene of every study that has no result yet; the runtime study last and alone.

    Raises:
        ConfigError: a folder belongs to another configuration, other weights or other code.
    """
    reports, machines = execute(studies, out, execution=execution, progress=progress)
    return Results(tuple(_result(study, out, reports) for study in studies), tuple(machines))


Reports = dict[tuple[Path, str], RunReport]


def execute(
    studies: Sequence[Study], out: Path, *, execution: Execution, progress: Progress
) -> tuple[Reports, list[str]]:
    """Run the scenes of the studies without looking at the results: all that a shard does.

    Returns:
        The reports by folder and variant, and the machines that the runtimes were measured on.

    Raises:
        ConfigError: as `run_studies`.
    """
    alone = Execution(LocalPool(1), execution.shard, share=False)
    together = [study for study in studies if study.name != RUNTIME]
    reports = _run(together, out, execution, progress)
    machines: list[str] = []
    for study in studies:
        if study.name == RUNTIME:
            folder = out / study.folder
            timed = _run([study], out, alone, progress)
            if any(report.resumed < len(report.finished) for report in timed.values()):
                _record_machine(folder)
            machines += _machines(folder)
            reports |= timed
    return reports, machines


def _run(studies: Sequence[Study], out: Path, execution: Execution, progress: Progress) -> Reports:
    names = [(study.folder, run.variant) for study in studies for run in study.runs]
    runs = [run for study in studies for run in study.runs]
    jobs = [
        RunJob(run, RunFolder(out / folder / variant))
        for run, (folder, variant) in zip(runs, names, strict=True)
    ]
    title = "runtime" if studies[0].name == RUNTIME else "paper"
    reports = run_jobs(jobs, execution=execution, progress=progress, title=title)
    return dict(zip(names, reports, strict=True))


def _result(study: Study, out: Path, reports: Reports) -> StudyResult:
    folders = {run.variant: RunFolder(out / study.folder / run.variant) for run in study.runs}
    own = {run.variant: reports[study.folder, run.variant] for run in study.runs}
    failed = {
        FailedScene(variant, scene): reason
        for variant, report in own.items()
        for scene, reason in report.failed.items()
    }
    runs = [
        ScoredRun(run, folders[run.variant], own[run.variant])
        for run in study.runs
        if own[run.variant].finished
    ]
    tracks = study.name.startswith(("tracking", "velocity"))
    bench = tuple(flow_values(runs)) if tracks else ()
    return StudyResult(study, _sampling(study.name, runs), failed, folders, bench)


def _sampling(name: str, runs: Sequence[ScoredRun]) -> Resamples:
    if not runs or name == BALL:
        return Resamples(())
    return _sample_times(runs) if name == RUNTIME else sample_runs(runs)


def _sample_times(runs: Sequence[ScoredRun]) -> Resamples:
    scenes = common_scenes(runs)
    weights = draw(max(len(scenes), 1), RESAMPLES)
    timings = {run.title: PerScene(scenes, run.folder.timings) for run in runs}
    figures = {title: flow_times(own, weights) for title, own in timings.items()}
    return Resamples(scenes, figures)


def flow_times(timings_s: Sequence[Mapping[str, F64]], weights: I64) -> RunMetrics:
    """Return mean and variance of the wall time of the flow on every resample of the scenes.

    Args:
        timings_s: of each of S scenes, per stage (T,) seconds.
        weights: (B, S) how often each scene counts in each resample.
    """
    parts = [_flow_ms(scene) for scene in timings_s]
    count = np.array([len(part) for part in parts], np.float64)
    total = np.array([part.sum() for part in parts])
    squares = np.array([(part**2).sum() for part in parts])
    mean, spread = Ratio(total, count), Pooled(variance, (total, squares, count))
    return {
        MetricKey(RUNTIME, "flow", "mean", "ms"): sample(mean, weights),
        MetricKey(RUNTIME, "flow", "variance", "ms²"): sample(spread, weights),
    }


def _flow_ms(timings_s: Mapping[str, F64]) -> F64:
    """Return (K,) milliseconds of the flows of a scene after warming up."""
    seconds = timings_s.get("flow", np.zeros(0))
    return 1e3 * seconds[seconds > 0][WARM_UP_FRAMES:]


def _record_machine(folder: Path) -> None:
    """Add this machine to those on which the results in a folder were timed."""
    import torch

    device = torch.cuda.get_device_name(0) if torch.cuda.is_available() else "no GPU"
    load = f"; load {os.getloadavg()[0]:.1f} at the end" if os.name == "posix" else ""
    mine = f"{_processor()}, {available_cores()} cores, {device}{load}"
    known = [machine for machine in _machines(folder) if machine != mine]
    write_text(folder / MACHINE_FILE, json.dumps([*known, mine], indent=1) + "\n")


def _machines(folder: Path) -> list[str]:
    """Return the machines on which the results in a folder were timed, as far as recorded."""
    path = folder / MACHINE_FILE
    return (
        [str(text) for text in json.loads(path.read_text(encoding="utf-8"))]
        if path.is_file()
        else []
    )


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    fields = (
        (line.partition(":") for line in info.read_text(encoding="utf-8").splitlines())
        if info.is_file()
        else ()
    )
    names = [value.strip() for name, _, value in fields if name.strip() == "model name"]
    return names[0] if names else platform.processor() or platform.machine()

"""Runs the studies, picks up where it stopped, and samples every figure by scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mottrack.core.result import SceneResult
from mottrack.eval.nuscenes.bootstrap import draw
from mottrack.eval.paired import (
    RESAMPLES,
    MetricKey,
    PairedDifference,
    Ratio,
    Sampled,
    Variance,
    paired,
    sample,
)
from mottrack.eval.run_figures import Figures
from mottrack.paper.claims import Finding, claims, judge
from mottrack.paper.machine import machines, note_machine
from mottrack.paper.plan import Study
from mottrack.runs.differences import Resamples, sample_runs
from mottrack.runs.run_folder import RunFolder
from mottrack.runs.runner import Job, RunReport, run_jobs
from mottrack.runs.scored_run import ScoredRun
from mottrack.runs.workers import Progress

WARM_UP_FRAMES = 3
"""The first flows of a scene pay for what is made once; they are left out of the runtime."""
RUNTIME, BALL = "runtime", "ball"


@dataclass(frozen=True)
class StudyResult:
    """A study after it has run."""

    study: Study
    sampling: Resamples
    failed: dict[str, str]
    """``variant/scene`` to the reason."""
    folders: dict[str, RunFolder]
    """Variant to its results."""

    def sampled(self, variant: str, key: MetricKey) -> Sampled | None:
        """A figure of one run on all resamples; None where it has not been measured."""
        return self.sampling.figures.get(variant, {}).get(key)

    def paired(self, rival: str, subject: str, key: MetricKey) -> PairedDifference | None:
        """Subject against rival; None where one of them has no such figure."""
        sides = self.sampled(rival, key), self.sampled(subject, key)
        if sides[0] is None or sides[1] is None:
            return None
        found = paired(key, sides[0], sides[1])
        return found if found.difference == found.difference else None


@dataclass(frozen=True)
class Results:
    """All studies."""

    studies: tuple[StudyResult, ...]
    machines: tuple[str, ...] = ()
    """What the runtimes were measured on, and its load; several where a run was continued."""

    def find(self, dataset: str, study: str) -> StudyResult | None:
        """One study; None where it was not asked for."""
        found = [s for s in self.studies if (s.study.dataset, s.study.name) == (dataset, study)]
        return found[0] if found else None

    @property
    def datasets(self) -> dict[str, str]:
        """Data set to its title, in order."""
        return {s.study.dataset: s.study.title for s in self.studies}

    @property
    def failed(self) -> dict[str, str]:
        """Everything that failed, and why."""
        return {
            f"{s.study.folder}/{name}": reason
            for s in self.studies
            for name, reason in s.failed.items()
        }

    def findings(self, dataset: str) -> list[Finding]:
        """Every claim against the runs on one data set, but for studies that could not be run."""
        found = []
        for claim in claims():
            study = self.find(dataset, claim.study)
            if study is not None and not study.study.reason:
                difference = study.paired(claim.rival, claim.subject, claim.key)
                found.append(Finding(claim, dataset, judge(claim, difference), difference))
        return found


def run_studies(
    studies: Sequence[Study], out: Path, *, workers: int, progress: Progress
) -> Results:
    """Runs every scene of every study that has no result yet; the runtime study last and alone.

    Raises:
        ConfigError: a folder belongs to another configuration, other weights or other code.
    """
    together = [study for study in studies if study.name != RUNTIME]
    reports = _run(together, out, workers, progress)
    machines_found: list[str] = []
    for study in studies:
        if study.name == RUNTIME:
            reports |= _run_alone(study, out, progress)
            machines_found += machines(out / study.folder)
    found = tuple(_result(study, out, reports) for study in studies)
    return Results(found, tuple(machines_found))


Reports = dict[tuple[Path, str], RunReport]


def _run_alone(study: Study, out: Path, progress: Progress) -> Reports:
    """Timed runs: one process, nothing of ours beside it."""
    reports = _run([study], out, 1, progress)
    if any(report.resumed < len(report.finished) for report in reports.values()):
        note_machine(out / study.folder)
    return reports


def _run(studies: Sequence[Study], out: Path, workers: int, progress: Progress) -> Reports:
    names = [(study.folder, run.variant) for study in studies for run in study.runs]
    runs = [run for study in studies for run in study.runs]
    jobs = [
        Job(run, RunFolder(out / folder / variant))
        for run, (folder, variant) in zip(runs, names, strict=True)
    ]
    title = "runtime" if studies[0].name == RUNTIME else "paper"
    reports = run_jobs(jobs, workers=workers, progress=progress, title=title)
    return dict(zip(names, reports, strict=True))


def _result(study: Study, out: Path, reports: Reports) -> StudyResult:
    folders = {run.variant: RunFolder(out / study.folder / run.variant) for run in study.runs}
    own = {run.variant: reports[study.folder, run.variant] for run in study.runs}
    failed = {
        f"{variant}/{scene}": reason
        for variant, report in own.items()
        for scene, reason in report.failed.items()
    }
    run_inputs = [
        ScoredRun(run, folders[run.variant], own[run.variant])
        for run in study.runs
        if own[run.variant].finished
    ]
    return StudyResult(study, _sampling(study.name, run_inputs), failed, folders)


def _sampling(name: str, run_inputs: Sequence[ScoredRun]) -> Resamples:
    if not run_inputs or name == BALL:
        return Resamples(())
    return sample_times(run_inputs) if name == RUNTIME else sample_runs(run_inputs)


def sample_times(run_inputs: Sequence[ScoredRun]) -> Resamples:
    """Mean and variance of the flow's time of every run, resampled by scene."""
    first = run_inputs[0].finished
    scenes = tuple(s for s in first if all(s in c.finished for c in run_inputs))
    weights = draw(max(len(scenes), 1), RESAMPLES)
    figures = {c.title: _times([c.load(s) for s in scenes], weights) for c in run_inputs}
    return Resamples(scenes, figures)


def _times(results: Sequence[SceneResult], weights: np.ndarray) -> Figures:
    parts = [_flow_ms(result) for result in results]
    count, total, squares = (
        np.array([f(part) for part in parts], np.float64)
        for f in (len, np.sum, lambda part: (part**2).sum())
    )
    return {
        MetricKey(RUNTIME, "flow", "mean", "ms"): sample(Ratio(total, count), weights),
        MetricKey(RUNTIME, "flow", "variance", "ms²"): sample(
            Variance(total, squares, count), weights
        ),
    }


def _flow_ms(result: SceneResult) -> np.ndarray:
    """(K,) milliseconds of the flows of a scene after the first few."""
    seconds = result.timings_s.get("flow", np.zeros(0))
    return 1e3 * seconds[seconds > 0][WARM_UP_FRAMES:]

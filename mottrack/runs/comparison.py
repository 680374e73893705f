"""Runs one experiment or a sweep of them, scores each, and says which differences are real."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mottrack.core.result import SceneResult
from mottrack.core.storage import write_text
from mottrack.eval.scores import Scores, score
from mottrack.eval.velocity_error import NO_ROWS, ErrorRow
from mottrack.experiment.experiment import Experiment
from mottrack.pipeline.latency import LatencyReport, StepTimes
from mottrack.runs.differences import (
    RunDifferences,
    RunInput,
    check_baseline,
    find_differences,
)
from mottrack.runs.run_folder import RunFolder
from mottrack.runs.runner import Job, RunReport, run_jobs
from mottrack.runs.workers import Progress, available_cores


@dataclass(frozen=True)
class ScoredRun:
    """One experiment of a comparison: where it is, how it went and what it was worth."""

    experiment: Experiment
    folder: RunFolder
    report: RunReport
    scores: Scores
    stage_ms: dict[str, float]
    """Mean wall time of each stage per key frame, milliseconds."""
    latency: LatencyReport | None
    """Of every step against the time between two sweeps; None where it was not kept."""

    @property
    def title(self) -> str:
        """What names the run in a table."""
        return self.experiment.title

    def run_input(self) -> RunInput:
        """The run as far as differences are concerned."""
        kind, config = self.experiment.dataset.kind, self.experiment.settings.scores
        return RunInput(self.title, kind, self.report.finished, self.folder.load, config)

    def velocity_error(self, row: str) -> ErrorRow:
        """One line of the velocity table; without rows where this run has none of the kind."""
        return self.scores.velocity.get(row, NO_ROWS)

    def as_dict(self) -> dict[str, Any]:
        """Plain data for scores.json."""
        parts = {g: getattr(self.experiment, g).kind for g in PARTS}
        return {
            "variant": self.experiment.variant,
            **parts,
            "config_hash": self.experiment.hash,
            "scenes": list(self.report.finished),
            "failed": self.report.failed,
            "stage_ms": self.stage_ms,
            "latency": None if self.latency is None else asdict(self.latency),
            "metrics": self.scores.as_dict(),
        }


PARTS = ("dataset", "objects", "flow", "tracker")


@dataclass(frozen=True)
class Comparison:
    """All runs of a sweep, in its order."""

    runs: tuple[ScoredRun, ...]
    out: Path
    differences: tuple[RunDifferences, ...] = ()
    """Every other run against the baseline of its data set."""

    @property
    def failed(self) -> dict[str, str]:
        """``variant/scene`` of every failed scene, and why."""
        return {
            "/".join(filter(None, (run.experiment.variant, scene))): reason
            for run in self.runs
            for scene, reason in run.report.failed.items()
        }


def velocity_rows(runs: Sequence[ScoredRun]) -> list[str]:
    """The lines of the velocity table that any run has, in order."""
    return list(dict.fromkeys(row for run in runs for row in run.scores.velocity))


def run_comparison(
    experiments: Sequence[Experiment],
    out: Path,
    *,
    workers: int,
    progress: Progress,
    baseline: str | None = None,
) -> Comparison:
    """Runs and scores every experiment; writes ``scores.json`` beside their results.

    Args:
        experiments: a sweep; a single one keeps its results in ``out`` itself, several in
            ``out/<variant>``.
        out: folder for results.
        workers: processes; 0 means one a core.
        progress: is told how the work goes on.
        baseline: title of the run, or part of it, that the others are compared with; the first.

    Raises:
        MottrackError: the configuration does not fit the data or the folder.
    """
    check_baseline(experiments, baseline)
    alone = len(experiments) == 1
    jobs = [Job(e, RunFolder(out if alone else out / e.variant)) for e in experiments]
    reports = run_jobs(jobs, workers=workers or available_cores(), progress=progress)
    runs = [
        scored_run(job.experiment, job.folder, report)
        for job, report in zip(jobs, reports, strict=True)
    ]
    differences = find_differences([run.run_input() for run in runs], baseline)
    comparison = Comparison(tuple(runs), out, differences)
    figures = {
        "runs": [run.as_dict() for run in runs],
        "differences": [part.as_dict() for part in differences],
    }
    write_text(out / "scores.json", json.dumps(figures, indent=1, allow_nan=False) + "\n")
    return comparison


def scored_run(experiment: Experiment, folder: RunFolder, report: RunReport) -> ScoredRun:
    """Scores what a run has left in its folder."""
    results = [folder.load(scene) for scene in report.finished]
    scores = score(results, experiment.settings.scores)
    times = [times for scene in report.finished if (times := folder.times(scene)) is not None]
    latency = StepTimes.joined(times).report() if times else None
    return ScoredRun(experiment, folder, report, scores, _stage_ms(results), latency)


def _stage_ms(results: Sequence[SceneResult]) -> dict[str, float]:
    stages = dict.fromkeys(stage for result in results for stage in result.timings_s)
    frames = max(sum(len(result.frames) for result in results), 1)
    totals = {s: sum(np.sum(r.timings_s.get(s, 0.0)) for r in results) for s in stages}
    return {stage: 1e3 * float(total) / frames for stage, total in totals.items()}

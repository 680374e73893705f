"""Comparisons: one experiment or a sweep of them, run and scored, or read back from a folder."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from mottrack.core.errors import ConfigError, ResultError, require_exists
from mottrack.core.storage import discard_unfinished, write_text
from mottrack.experiment.experiment import Experiment
from mottrack.experiment.stored import stored_experiment
from mottrack.formats.files import read_bytes
from mottrack.formats.json_text import parse_json
from mottrack.runs.criteria import Judged, judge
from mottrack.runs.differences import RunDifferences, check_baseline, find_differences
from mottrack.runs.equal_runs import equal_runs
from mottrack.runs.run_folder import RunFolder
from mottrack.runs.runner import Execution, RunJob, RunReport, run_jobs
from mottrack.runs.scored_run import ScoredRun
from mottrack.runs.tasks import Progress
from mottrack.runs.velocity_bench import FlowValue, flow_values

__all__ = ["Comparison", "ScoredRun", "load_comparison", "run_comparison", "variants_of"]


@dataclass(frozen=True)
class Comparison:
    """All runs of a sweep, in its order."""

    runs: tuple[ScoredRun, ...]
    out: Path
    differences: tuple[RunDifferences, ...] = ()
    """Every other run against the baseline of its data set."""

    def __repr__(self) -> str:
        titles = ", ".join(run.title for run in self.runs)
        return f"Comparison({titles}; {self.out})"

    @cached_property
    def flow_values(self) -> list[FlowValue]:
        """What each flow source was worth beside no flow."""
        return flow_values(self.runs)

    @cached_property
    def judged(self) -> list[Judged]:
        """The criteria of the experiment with their verdicts."""
        criteria = (c for run in self.runs for c in run.experiment.settings.criteria)
        return judge(list(dict.fromkeys(criteria)), self.flow_values)

    @cached_property
    def equal(self) -> dict[str, str]:
        """The title of each run whose tracks are those of an earlier one, and of that one."""
        return equal_runs(self.runs)

    @property
    def failed(self) -> dict[str, str]:
        """``variant/scene`` of every failed scene to the reason."""
        return {
            "/".join(filter(None, (run.experiment.variant, scene))): reason
            for run in self.runs
            for scene, reason in run.report.failed.items()
        }


def run_comparison(
    experiments: Sequence[Experiment],
    out: Path,
    *,
    execution: Execution,
    progress: Progress,
    baseline: str | None = None,
) -> Comparison:
    """Run and score every experiment; write ``scores.json`` beside their results.

    Args:
        experiments: a sweep; a single one stores its results in ``out`` itself, several in
            ``out/<variant>``.
        out: folder for results.
        execution: where the scenes are run; all of them, no shard.
        progress: receives the progress of the work.
        baseline: title of the baseline run, or part of it; by default the first run.

    Raises:
        MottrackError: the configuration does not fit the data or the folder.
    """
    check_baseline(experiments, baseline)
    jobs = comparison_jobs(experiments, out)
    reports = run_jobs(jobs, execution=execution, progress=progress)
    runs = tuple(
        ScoredRun(job.experiment, job.folder, report)
        for job, report in zip(jobs, reports, strict=True)
    )
    return score_runs(runs, out, baseline)


def comparison_jobs(experiments: Sequence[Experiment], out: Path) -> list[RunJob]:
    """Return the runs of a sweep with their folders: ``out`` itself for one, else one in it."""
    alone = len(experiments) == 1
    return [RunJob(e, RunFolder(out if alone else out / e.variant)) for e in experiments]


def score_runs(runs: tuple[ScoredRun, ...], out: Path, baseline: str | None = None) -> Comparison:
    """Score finished runs and test their differences; write ``scores.json``.

    Raises:
        ResultError: a stored result is damaged.
    """
    for folder in (out, out / "tables"):  # of a driver that was killed while it wrote figures
        discard_unfinished(folder)
    comparison = Comparison(runs, out, find_differences(runs, baseline))
    figures = {
        "runs": [run.as_dict() for run in runs],
        "differences": [part.as_dict() for part in comparison.differences],
    }
    write_text(out / "scores.json", json.dumps(figures, indent=1, allow_nan=False) + "\n")
    return comparison


def load_comparison(folder: Path, baseline: str | None = None) -> Comparison:
    """Read the runs of a folder that ``mottrack run`` or ``compare`` wrote; score them anew.

    Args:
        folder: of one run, or of several in a folder each.
        baseline: title of the baseline run, or part of it; by default the first run.

    Raises:
        ConfigError: the folder does not exist, or holds no run with a finished scene.
        ResultError: a stored result is damaged.
    """
    require_exists(folder, "the folder of a run or of a comparison")
    notes = _notes(folder)
    runs = [_load_run(folder, variant, notes.get(variant, {})) for variant in variants_of(folder)]
    runs = [run for run in runs if run.finished]
    if not runs:
        raise ConfigError(
            f"{folder} holds no finished scene of any run; expected a folder that mottrack run or "
            "compare wrote"
        )
    return Comparison(tuple(runs), folder, find_differences(runs, baseline))


def variants_of(folder: Path) -> list[str]:
    """Return the names of the runs, in order; "" where the folder is a run itself."""
    if RunFolder(folder).identity_file.exists():
        return [""]
    there = sorted(file.parent.name for file in folder.glob("*/run.json"))
    listed = [variant for variant in _notes(folder) if variant in there]
    return listed + [variant for variant in there if variant not in listed]


def _notes(folder: Path) -> dict[str, Mapping[str, Any]]:
    """Return each variant's part of scores.json; nothing if the comparison was interrupted."""
    path = folder / "scores.json"
    if not path.exists():
        return {}
    try:
        notes = {run["variant"]: run for run in parse_json(path, read_bytes(path))["runs"]}
    except (KeyError, TypeError) as error:
        raise ResultError(path, "content", repr(error), "figures of a comparison") from error
    for note in notes.values():
        listed, failed = note.get("scenes", []), note.get("failed", {})
        if not isinstance(listed, list) or not isinstance(failed, dict):
            raise ResultError(path, "runs", "scenes or failed of another type", "a list, a mapping")
    return notes


def _load_run(folder: Path, variant: str, note: Mapping[str, Any]) -> ScoredRun:
    run = RunFolder(folder / variant)
    there = dict.fromkeys(run.scenes)
    # in the order of the data set, as far as it is known
    listed = map(str, note.get("scenes", ()))
    finished = tuple(dict.fromkeys(scene for scene in listed if scene in there) | there)
    report = RunReport(finished, failed=dict(note.get("failed", {})), resumed=0)
    return stored_run(run, variant, report)


def stored_run(folder: RunFolder, variant: str, report: RunReport) -> ScoredRun:
    """Return a run of a folder, composed from the configuration that lies in it.

    Raises:
        ConfigError: the configuration is of another version.
    """
    experiment = stored_experiment(folder.config_file, folder.stored_hash, variant)
    return ScoredRun(experiment, folder, report)

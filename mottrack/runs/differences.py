"""Differences between runs on the same scenes: every run against a baseline, with intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mottrack.core.arrays import I64
from mottrack.core.errors import unknown_name
from mottrack.eval.paired import PairedDifference, paired_all
from mottrack.eval.run_metrics import Resampling, RunMetrics
from mottrack.experiment.experiment import Experiment
from mottrack.formats.strict_json import strict
from mottrack.runs.label_free import label_free_metrics
from mottrack.runs.scene_flow import scene_flow_metrics
from mottrack.runs.scored_run import ScoredRun


@dataclass(frozen=True)
class RunDifferences:
    """One run against its baseline."""

    run: str
    """Title of the run."""
    baseline: str
    """Title of the baseline."""
    scenes: int
    """Number of scenes that all runs of the data set have finished."""
    rows: tuple[PairedDifference, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return plain data for scores.json; an interval that does not exist is None."""
        return {
            "run": self.run,
            "baseline": self.baseline,
            "scenes": self.scenes,
            "figures": [_as_dict(row) for row in self.rows],
        }


@dataclass(frozen=True)
class Resamples:
    """Metrics of all runs of one data set over the scenes that they have in common."""

    scenes: tuple[str, ...]
    figures: dict[str, RunMetrics] = field(default_factory=dict)
    """Title of a run to its metrics on every resample."""
    weights: I64 = field(default_factory=lambda: np.zeros((0, 0), np.int64))
    """(B, S) how often each scene counts in each resample."""

    def against(self, baseline: str, run: str) -> RunDifferences:
        """Compare every metric of the run with the baseline's."""
        rows = paired_all(self.figures[baseline], self.figures[run])
        return RunDifferences(run, baseline, len(self.scenes), rows)


def sample_runs(runs: Sequence[ScoredRun]) -> Resamples:
    """Resample the metrics of runs on the same data set, all with the same draws."""
    scenes = common_scenes(runs)
    if not scenes:
        return Resamples(())
    common = Resampling.of([run.over(scenes, runs[0].config) for run in runs])
    figures = {run.title: run.figures(common, scenes, runs[0].config) for run in runs}
    for run in runs:
        extra = scene_flow_metrics(run, scenes, common.weights)
        extra |= label_free_metrics(run, scenes, common.weights)
        figures[run.title] = figures[run.title] | extra
    return Resamples(scenes, figures, common.weights)


def common_scenes(runs: Sequence[ScoredRun]) -> tuple[str, ...]:
    """Return the scenes that all runs have finished, in the order of the first run."""
    shared = set(runs[0].finished).intersection(*(run.finished for run in runs))
    return tuple(scene for scene in runs[0].finished if scene in shared)


def find_differences(runs: Sequence[ScoredRun], baseline: str | None) -> tuple[RunDifferences, ...]:
    """Compare every run with the baseline of its data set: the named run, else the first one."""
    found: list[RunDifferences] = []
    for kind in dict.fromkeys(run.dataset for run in runs):
        group = [run for run in runs if run.dataset == kind and run.finished]
        if len(group) < 2:
            continue
        samples = sample_runs(group)
        first = _baseline_of([run.title for run in group], baseline)
        others = [run.title for run in group if run.title != first] if samples.scenes else []
        found += [samples.against(first, other) for other in others]
    return tuple(found)


def check_baseline(experiments: Sequence[Experiment], baseline: str | None) -> None:
    """Refuse a baseline that names no run, before anything runs.

    Raises:
        ConfigError: no variant has that name or that part of a name.
    """
    titles = [experiment.title for experiment in experiments]
    if baseline is not None and not any(_is_named(title, baseline) for title in titles):
        raise unknown_name("baseline", baseline, titles)


def _baseline_of(titles: Sequence[str], baseline: str | None) -> str:
    if baseline is None:
        return titles[0]
    exact = [title for title in titles if title == baseline]
    part = [title for title in titles if _is_named(title, baseline)]
    return [*exact, *part, titles[0]][0]


def _is_named(title: str, name: str) -> bool:
    """Return whether ``name`` means the run: ``zero`` also means ``kitti+zero``."""
    return title == name or set(name.split("+")) <= set(title.split("+"))


def _as_dict(row: PairedDifference) -> dict[str, Any]:
    plain: dict[str, Any] = strict(
        {
            "table": row.key.table,
            "row": row.key.row,
            "metric": row.key.metric,
            "unit": row.key.unit,
            "baseline": row.baseline,
            "value": row.value,
            "difference": row.difference,
            "low": row.low,
            "high": row.high,
            "significant": row.significant,
            "better": row.better,
            "scenes": row.scenes,
        }
    )
    return plain

"""What of a comparison is real: every run against a baseline on the same scenes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from mottrack.core.errors import unknown_name
from mottrack.core.result import SceneResult
from mottrack.eval.paired import PairedDifference, paired_all
from mottrack.eval.run_metrics import Resampling, RunMetrics, run_metrics
from mottrack.eval.scores import ScoreConfig
from mottrack.experiment.experiment import Experiment

Load = Callable[[str], SceneResult]


@dataclass(frozen=True)
class RunDifferences:
    """One run against its baseline."""

    run: str
    """Title of the run."""
    baseline: str
    """Title of the baseline."""
    scenes: int
    """Scenes that all runs of the data set have finished."""
    rows: tuple[PairedDifference, ...]

    def as_dict(self) -> dict[str, Any]:
        """Plain data for scores.json; an interval that can't be given is None."""
        return {
            "run": self.run,
            "baseline": self.baseline,
            "scenes": self.scenes,
            "figures": [_plain(row) for row in self.rows],
        }


@dataclass(frozen=True)
class RunInput:
    """A run as far as differences are concerned."""

    title: str
    dataset: str
    """Kind of its data set: scenes of the same name are the same only within one."""
    finished: tuple[str, ...]
    load: Load
    config: ScoreConfig


@dataclass(frozen=True)
class Resamples:
    """The figures of all runs of one data set over the scenes that they have in common."""

    scenes: tuple[str, ...]
    figures: dict[str, RunMetrics] = field(default_factory=dict)
    """Title of a run to its figures on every resample."""

    def against(self, baseline: str, run: str) -> RunDifferences:
        """Every figure of the run against the baseline's."""
        rows = paired_all(self.figures[baseline], self.figures[run])
        return RunDifferences(run, baseline, len(self.scenes), rows)


def sample_runs(run_inputs: Sequence[RunInput]) -> Resamples:
    """Resamples the figures of runs on the same data set, all with the same draws."""
    scenes = tuple(
        scene
        for scene in run_inputs[0].finished
        if all(scene in run_input.finished for run_input in run_inputs)
    )
    if not scenes:
        return Resamples(())
    results = {c.title: [c.load(scene) for scene in scenes] for c in run_inputs}
    common = Resampling.of(list(results.values()), run_inputs[0].config)
    return Resamples(scenes, {title: run_metrics(run, common) for title, run in results.items()})


def find_differences(
    run_inputs: Sequence[RunInput], baseline: str | None
) -> tuple[RunDifferences, ...]:
    """Every run against the baseline of its data set: the named run, else the first one."""
    found: list[RunDifferences] = []
    for kind in dict.fromkeys(run_input.dataset for run_input in run_inputs):
        group = [c for c in run_inputs if c.dataset == kind and c.finished]
        if len(group) < 2:
            continue
        sampling = sample_runs(group)
        first = _baseline_of([c.title for c in group], baseline)
        others = [c.title for c in group if c.title != first] if sampling.scenes else []
        found += [sampling.against(first, other) for other in others]
    return tuple(found)


def check_baseline(experiments: Sequence[Experiment], baseline: str | None) -> None:
    """Refuses a baseline that no run answers to, before anything runs.

    Raises:
        ConfigError: no variant has that name or that part of a name.
    """
    titles = [experiment.title for experiment in experiments]
    if baseline is not None and not any(_answers(title, baseline) for title in titles):
        raise unknown_name("baseline", baseline, titles)


def _baseline_of(titles: Sequence[str], baseline: str | None) -> str:
    if baseline is None:
        return titles[0]
    exact = [title for title in titles if title == baseline]
    part = [title for title in titles if _answers(title, baseline)]
    return [*exact, *part, titles[0]][0]


def _answers(title: str, baseline: str) -> bool:
    """Whether a run is meant: ``zero`` means ``kitti+zero`` as well."""
    return title == baseline or set(baseline.split("+")) <= set(title.split("+"))


def _plain(row: PairedDifference) -> dict[str, Any]:
    key = row.key
    names = {"table": key.table, "row": key.row, "metric": key.metric, "unit": key.unit}
    numbers = {
        "baseline": row.baseline,
        "value": row.value,
        "difference": row.difference,
        "low": row.low,
        "high": row.high,
    }
    finite = {name: None if x != x else x for name, x in numbers.items()}
    return {**names, **finite, "real": row.significant, "better": row.better, "scenes": row.scenes}

"""A finished run and its figures, each computed once, when first needed; results are not held."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import asdict, dataclass, field
from functools import cached_property, partial
from typing import Any

from mottrack.core.concerns import Concern, SceneConcern, summaries
from mottrack.core.result import SceneResult
from mottrack.datasets.plausibility.seen import SeenScene
from mottrack.datasets.plausibility.watch import scene_concerns
from mottrack.eval.evaluation import Evaluation
from mottrack.eval.run_metrics import Resampling, RunMetrics, run_metrics
from mottrack.eval.scores import ScoreConfig, Scores
from mottrack.eval.velocity_error import NO_ROWS, ErrorRow
from mottrack.experiment.experiment import Experiment
from mottrack.experiment.overrides import GROUPS
from mottrack.pipeline.latency import LatencyReport, latency_report
from mottrack.runs.per_scene import PerScene
from mottrack.runs.run_folder import RunFolder
from mottrack.runs.runner import RunReport

TRUE_FLOW = "ground_truth"
"""The flow source that is given the truth."""


@dataclass(frozen=True)
class ScoredRun:
    """One experiment after it has run: its configuration, its results and what they amount to.

    A stored result that is damaged raises ResultError where it is first needed.
    """

    experiment: Experiment
    folder: RunFolder
    report: RunReport
    _evaluations: dict[Hashable, Evaluation] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    _figures: dict[Hashable, RunMetrics] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __repr__(self) -> str:
        return f"ScoredRun({self.title}, {len(self.finished)} scenes, {self.folder.path})"

    @property
    def title(self) -> str:
        """Name of the run in tables."""
        return self.experiment.title

    @property
    def dataset(self) -> str:
        """Kind of the data set: scenes of the same name are the same only within one."""
        return self.experiment.dataset.kind

    @property
    def finished(self) -> tuple[str, ...]:
        """Names of the scenes with a result."""
        return self.report.finished

    @property
    def given_truth(self) -> bool:
        """Whether its flow is the truth: an upper bound, no method."""
        return self.experiment.flow.kind == TRUE_FLOW

    @property
    def has_truth(self) -> bool:
        """Whether there was any truth to score it against."""
        return self.scores.overall.clear.truth > 0

    @property
    def config(self) -> ScoreConfig:
        """How its boxes are matched."""
        return self.experiment.settings.scores

    @property
    def evaluation(self) -> Evaluation:
        """Of all finished scenes, matched as the run's configuration says."""
        return self.over(self.finished, self.config)

    def figures(
        self, common: Resampling, scenes: tuple[str, ...], config: ScoreConfig
    ) -> RunMetrics:
        """Return the metrics on every resample of the scenes that several runs have in common."""
        key = scenes, config, common.rules, len(common.weights)
        if key not in self._figures:
            self._figures[key] = run_metrics(self.over(scenes, config), common)
        return self._figures[key]

    def over(self, scenes: tuple[str, ...], config: ScoreConfig) -> Evaluation:
        """Return the evaluation of some of the finished scenes."""
        key = scenes, config
        if key not in self._evaluations:
            results = PerScene(scenes, self.folder.load)
            boxes = PerScene(scenes, partial(self.folder.load, flow=False))
            self._evaluations[key] = Evaluation(results, config, boxes)
        return self._evaluations[key]

    @cached_property
    def scores(self) -> Scores:
        """Scores over all finished scenes."""
        return self.evaluation.scores

    def load(self, scene: str) -> SceneResult:
        """Read the result of a finished scene.

        Raises:
            ResultError: it is missing or damaged.
        """
        return self.folder.load(scene)

    @cached_property
    def concerns(self) -> list[str]:
        """What is unlikely in the data of the finished scenes, a line for each kind."""
        found: list[SceneConcern] = []
        for scene in self.finished:
            result = self.folder.load(scene, flow=False)
            # boxes in an image have no heading and no size that could be unlikely
            concerns = result.concerns if self.dataset == "mot" else _concerns(result)
            found += [SceneConcern(scene, concern) for concern in concerns]
        return summaries(found)

    @cached_property
    def latency(self) -> LatencyReport | None:
        """Of its steps against the time between two sweeps; None where it was not stored."""
        stored = tuple(s for s in self.finished if self.folder.latency_file(s).exists())
        return latency_report(PerScene(stored, self.folder.times)) if stored else None

    def velocity_error(self, row: str) -> ErrorRow:
        """Return one row of the velocity table; one without tracks if the run has none of it."""
        return self.scores.velocity.get(row, NO_ROWS)

    def as_dict(self) -> dict[str, Any]:
        """Return plain data for scores.json."""
        kinds = {g: part.kind for g, part in zip(GROUPS, self.experiment.parts, strict=True)}
        return {
            "variant": self.experiment.variant,
            **kinds,
            "config_hash": self.experiment.hash,
            "scenes": list(self.finished),
            "failed": self.report.failed,
            "latency": None if self.latency is None else asdict(self.latency),
            "metrics": self.scores.as_dict(),
        }


def _concerns(result: SceneResult) -> list[Concern]:
    """Return what was found while the scene was read, and what its tracks add to that."""
    known = {concern.kind for concern in result.concerns}
    of_tracks = scene_concerns(SeenScene.of_result(result))
    return [*result.concerns, *(c for c in of_tracks if c.kind not in known)]

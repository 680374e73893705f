"""A finished run with its results and scores, each read or computed once, when first needed."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any

from mottrack.core.concerns import SceneConcern, summaries
from mottrack.core.result import SceneResult
from mottrack.datasets.plausibility.seen import SeenScene
from mottrack.datasets.plausibility.watch import scene_concerns
from mottrack.eval.memo import Memo
from mottrack.eval.scores import ScoreConfig, Scores, score
from mottrack.eval.velocity_error import NO_ROWS, ErrorRow
from mottrack.experiment.experiment import Experiment
from mottrack.experiment.overrides import GROUPS
from mottrack.pipeline.latency import LatencyReport, StepTimes
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
    memo: Memo = field(default_factory=Memo, init=False, repr=False, compare=False)
    """Intermediate values of the metrics, shared by all evaluations of the run."""
    _results: dict[str, SceneResult] = field(
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

    def load(self, scene: str) -> SceneResult:
        """Return the result of a finished scene with its timings; read it the first time.

        Raises:
            ResultError: it is missing or damaged.
        """
        if scene not in self._results:
            self._results[scene] = self.folder.load(scene)
        return self._results[scene]

    @property
    def results(self) -> list[SceneResult]:
        """Results of all finished scenes."""
        return [self.load(scene) for scene in self.finished]

    @cached_property
    def concerns(self) -> list[str]:
        """What is unlikely in the data of the finished scenes, a line for each kind."""
        return summaries(
            SceneConcern(scene, concern)
            for scene in self.finished
            for concern in scene_concerns(SeenScene.of_result(self.load(scene)))
        )

    @cached_property
    def scores(self) -> Scores:
        """Scores over all finished scenes."""
        return score(self.results, self.config, self.memo)

    @cached_property
    def latency(self) -> LatencyReport | None:
        """Of its steps against the time between two sweeps; None where it was not stored."""
        times = [times for scene in self.finished if (times := self.folder.times(scene))]
        return StepTimes.joined(times).report() if times else None

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

"""Judgement of weights on held-out stretches, without labels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mottrack.core.interfaces import Dataset, Scene
from mottrack.core.sweep import Sweep
from mottrack.eval.label_free import COMPARED, ERROR, LabelFreeSums, SceneJudgements
from mottrack.eval.paired import RESAMPLES, PairedDifference, draw, paired_all
from mottrack.experiment.settings import Settings
from mottrack.flow.pillarflow.source import PillarFlow, PillarFlowConfig
from mottrack.pipeline.label_free import CHECK_GRID, CHECK_S
from mottrack.pipeline.label_free_sampler import Evidences
from mottrack.pipeline.sweep_pairs import PairConfig
from mottrack.studies.adaptation.stretches import Stretch, earlier_sweep

OnFrame = Callable[[int, int], None]
FRAMES = 8
"""Frames of a stretch that are judged, evenly spread: neighbours say nearly the same."""
FIELDS = ("network alone", "with the stages after it")


@dataclass(frozen=True)
class Verdict:
    """Weights before and after on the same held-out stretches."""

    stretches: int
    fields: dict[str, tuple[PairedDifference, ...]]
    """`FIELDS` to the differences of every figure, after against before."""

    def error(self, field: str) -> PairedDifference | None:
        """Return the difference of the label-free error; None where nothing could be judged."""
        return next((row for row in self.fields[field] if row.key == ERROR), None)

    def as_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return {
            name: {f"{row.key.row} {row.key.metric}": row.as_dict() for row in rows}
            for name, rows in self.fields.items()
        }


@dataclass(frozen=True)
class Judge:
    """The held-out stretches of the logs."""

    dataset: Dataset
    stretches: Sequence[Stretch]
    config: PillarFlowConfig
    """Of the flow; its weights are set here."""
    settings: Settings
    """Of the experiment: which earlier sweeps flow is measured from."""

    def compare(self, before: str, after: Path, on_frame: OnFrame) -> Verdict:
        """Judge two weights on the same frames, the network alone and with the stages after it."""
        sources = [
            PillarFlow(self.config.model_copy(update={"weights": name}), grid=CHECK_GRID)
            for name in (before, str(after))
        ]
        per_stretch = []
        for k, stretch in enumerate(self.stretches):
            per_stretch.append(self._judge(stretch, sources))
            on_frame(k + 1, len(self.stretches))
        weights = draw(len(per_stretch), RESAMPLES)
        columns = [
            SceneJudgements(tuple(sums[i] for sums in per_stretch)).sampled(weights)
            for i in range(len(FIELDS) * len(sources))
        ]
        rows = [
            tuple(d for d in paired_all(columns[i], columns[i + 2]) if d.key in COMPARED)
            for i in range(len(FIELDS))
        ]
        return Verdict(len(per_stretch), dict(zip(FIELDS, rows, strict=True)))

    def _judge(self, stretch: Stretch, sources: Sequence[PillarFlow]) -> list[LabelFreeSums]:
        """Return the sums of each field of each source: all fields of the first come first."""
        scene, evidences = self.dataset.scene(stretch.scene), Evidences()
        sums = [LabelFreeSums() for _ in range(len(FIELDS) * len(sources))]
        step = max(len(stretch.frames) // FRAMES, 1)
        for index in stretch.frames[::step]:
            earlier = earlier_sweep(scene, index, CHECK_S)
            if earlier is None:
                continue
            current = scene.sweep(index)
            evidence = evidences.of(earlier, current)
            for k, source in enumerate(sources):
                past = self._past(scene, index, source)
                if past:
                    pair = source.stages.before(source.in_use(past, current), current)
                    raw = source.raw(pair)
                    sums[2 * k] += evidence.judge(raw)
                    sums[2 * k + 1] += evidence.judge(source.stages.after(raw, pair))
        return sums

    def _past(self, scene: Scene, index: int, source: PillarFlow) -> list[Sweep]:
        """Return the sweeps before a frame that a source uses, from the oldest to the newest."""
        ages_s = [self.settings.pair_s, *PairConfig.of(self.settings, source).ages_s]
        found = [earlier_sweep(scene, index, age_s) for age_s in ages_s]
        if found[0] is None:
            return []
        return [sweep for sweep in reversed(found) if sweep is not None]

"""All metrics of a run that a comparison reports, each resampled by scene."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mottrack.core import InputError, SceneResult
from mottrack.core.arrays import F64, I64
from mottrack.eval.arithmetic import mota, ratio
from mottrack.eval.flow_error import cell_errors, kind_masks
from mottrack.eval.memo import Memo
from mottrack.eval.nuscenes.prepare import prepare_results, rules_for
from mottrack.eval.nuscenes.resampling import profiles, sampled_metrics
from mottrack.eval.nuscenes.rules import Rules
from mottrack.eval.paired import (
    RESAMPLES,
    Metric,
    MetricKey,
    Pooled,
    Ratio,
    Sampled,
    Sum,
    TailMean,
    draw,
    sample,
)
from mottrack.eval.scores import (
    ScoreConfig,
    ScoreFilter,
    class_aware,
    counted_labels,
    scene_scores,
    scored_part,
)
from mottrack.eval.velocity_error import category_masks, velocity_samples

ALL = "all"
OFFICIAL = (
    MetricKey("tracking", ALL, "AMOTA", lower_is_better=False),
    MetricKey("tracking", ALL, "AMOTP", "m"),
    MetricKey("tracking", ALL, "MOTA", lower_is_better=False),
    MetricKey("tracking", ALL, "MOTP", "m"),
    MetricKey("tracking", ALL, "IDS"),
)
IOU_DISTANCE = MetricKey("tracking", ALL, "mean 1 - IoU of matches")
"""What MOTP is where boxes are matched by their IoU."""
RunMetrics = dict[MetricKey, Sampled]


@dataclass(frozen=True)
class Resampling:
    """What the runs that are compared have in common."""

    weights: I64
    """(B, S) how often each scene counts in each resample."""
    rules: Rules | None
    """Of the class-aware evaluation; None where it is class-agnostic (clusters)."""
    config: ScoreConfig

    @classmethod
    def of(
        cls, runs: Sequence[Sequence[SceneResult]], config: ScoreConfig, resamples: int = RESAMPLES
    ) -> Resampling:
        """Draw resamples for runs over the same scenes, in the same order."""
        scored = [[scored_part(result, config) for result in results] for results in runs]
        labels = counted_labels(result for results in scored for result in results)
        aware = all(class_aware(results) for results in scored) and not config.class_agnostic
        rules = rules_for(labels) if aware and labels else None
        return cls(draw(len(runs[0]), resamples), rules, config)


def run_metrics(
    results: Sequence[SceneResult], common: Resampling, memo: Memo | None = None
) -> RunMetrics:
    """Return all metrics of a run, on the whole and on every resample.

    MOTA, MOTP and IDS are the official ones: means over the classes (IDS: the sum), each class at
    its best score, which is sought anew in every resample. Where the evaluation is class-agnostic
    they are those of all boxes together.
    """
    memo = memo or Memo()
    scored = [memo(scored_part, result, common.config) for result in results]
    metrics = dict(_velocity(results, common.config, memo)) | dict(_flow(scored))
    sampled = {key: sample(metric, common.weights) for key, metric in metrics.items()}
    return _tracking(scored, common, memo) | sampled


def _tracking(results: Sequence[SceneResult], common: Resampling, memo: Memo) -> RunMetrics:
    if common.rules is None:
        pooled = _pooled(results, common.config)
        return {key: sample(metric, common.weights) for key, metric in pooled}
    try:
        classes = profiles(memo(prepare_results, results, common.rules), common.rules)
    except InputError:  # no box in range on one side: there is nothing to average
        return {}
    official = sampled_metrics(classes, common.weights, common.rules)[ALL]
    return {key: official[key.metric.lower()] for key in OFFICIAL}


def _pooled(
    results: Sequence[SceneResult], config: ScoreConfig
) -> Iterator[tuple[MetricKey, Metric]]:
    counts = [scene_scores(result, ScoreFilter(""), config).clear for result in results]
    errors, truth = _column(c.errors for c in counts), _column(c.truth for c in counts)
    distance, hits = _column(c.distance for c in counts), _column(c.hits for c in counts)
    _, _, mota_key, motp_key, ids_key = OFFICIAL
    yield mota_key, Pooled(mota, (errors, truth))
    yield (
        motp_key if config.match_by == "distance" else IOU_DISTANCE,
        Pooled(ratio, (distance, hits)),
    )
    yield ids_key, Sum(_column(c.switches for c in counts))


def _velocity(
    results: Sequence[SceneResult], config: ScoreConfig, memo: Memo
) -> Iterator[tuple[MetricKey, Metric]]:
    parts = [memo(scored_part, result, config, truth=False) for result in results]
    samples = [memo(velocity_samples, part, config.velocity) for part in parts]
    declared = {name for result in results for name in result.classes}
    masks = [category_masks(part, config.velocity, declared) for part in samples]
    for row in dict.fromkeys(row for mask in masks for row in mask):
        errors = [
            part.error_mps[mask[row]] if row in mask else np.zeros(0)
            for part, mask in zip(samples, masks, strict=True)
        ]
        if any(len(part) for part in errors):
            yield MetricKey("velocity", row, "mean", "m/s"), Ratio.mean(errors)
            yield MetricKey("velocity", row, "worst 5 %", "m/s"), TailMean.of(errors)


def _flow(results: Sequence[SceneResult]) -> Iterator[tuple[MetricKey, Metric]]:
    if not any(len(result.flow) for result in results):
        return
    masks = [kind_masks(result.flow) for result in results]
    for row in ("dynamic", "static", ALL):
        cells = [r.flow.select(mask[row]) for r, mask in zip(results, masks, strict=True)]
        errors = [cell_errors(part) for part in cells]
        rms = Ratio.root_mean_square
        yield MetricKey("flow", row, "RMSE", "m/s"), rms([e.speed_mps for e in errors])
        yield MetricKey("flow", row, "RMSE of the flow", "m"), rms([e.length_m for e in errors])
        yield MetricKey("flow", row, "AAE", "rad"), Ratio.mean([e.angle_rad for e in errors])


def _column(values: Iterable[float]) -> F64:
    return np.array(list(values), np.float64)

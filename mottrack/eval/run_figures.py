"""Every figure of a run that a comparison is about, in the form that can be resampled by scene."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mottrack.core import InputError, SceneResult
from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.tables import FlowSamples
from mottrack.eval.flow_error import angular_error
from mottrack.eval.memo import Memo
from mottrack.eval.nuscenes.bootstrap import draw, evaluate_weighted, profiles
from mottrack.eval.nuscenes.from_results import prepare_results, rules_for
from mottrack.eval.nuscenes.profile import Profile
from mottrack.eval.nuscenes.rules import Rules
from mottrack.eval.paired import RESAMPLES, Metric, MetricKey, Ratio, Sampled, Sum, TailMean, sample
from mottrack.eval.scores import ScoreConfig, ScoreFilter, counted_labels, scene_scores
from mottrack.eval.velocity_error import category_masks, velocity_samples

ALL = "all"
OFFICIAL = (
    MetricKey("tracking", ALL, "AMOTA", lower_is_better=False),
    MetricKey("tracking", ALL, "AMOTP", "m"),
    MetricKey("tracking", ALL, "MOTA", lower_is_better=False),
    MetricKey("tracking", ALL, "MOTP", "m"),
    MetricKey("tracking", ALL, "IDS"),
)
Figures = dict[MetricKey, Sampled]


@dataclass(frozen=True)
class Resampling:
    """What the runs that are compared have in common."""

    weights: I64
    """(B, S) how often each scene counts in each resample."""
    rules: Rules | None
    """Classes that are told apart; None where they are not (clusters)."""
    config: ScoreConfig

    @classmethod
    def of(
        cls, runs: Sequence[Sequence[SceneResult]], config: ScoreConfig, resamples: int = RESAMPLES
    ) -> Resampling:
        """For runs over the same scenes, in the same order."""
        every = [result for results in runs for result in results]
        labels = counted_labels(every)
        apart = all(_told_apart(results) for results in runs) and not config.class_agnostic
        rules = rules_for(labels) if apart and labels else None
        return cls(draw(len(runs[0]), resamples), rules, config)


def run_figures(
    results: Sequence[SceneResult], common: Resampling, memo: Memo | None = None
) -> Figures:
    """Every figure of a run, on the whole and on every resample.

    MOTA, MOTP and IDS are the official ones: means over the classes (IDS: the sum), each class at
    its best score, which is sought anew in every resample. Where classes are not told apart they
    are those of all boxes together.
    """
    memo = memo or Memo()
    labelled = [memo(SceneResult.where_labelled, result) for result in results]
    figures = dict(_velocity(labelled, common.config, memo)) | dict(_flow(results))
    sampled = {key: sample(figure, common.weights) for key, figure in figures.items()}
    return _tracking(labelled, common, memo) | sampled


def _tracking(results: Sequence[SceneResult], common: Resampling, memo: Memo) -> Figures:
    if common.rules is None:
        pooled = _pooled(results, common.config)
        return {key: sample(figure, common.weights) for key, figure in pooled}
    try:
        classes = profiles(memo(prepare_results, results, common.rules), common.rules)
    except InputError:  # no box in range on one side: there is nothing to average
        return {}
    return _official(classes, common)


def _official(classes: Sequence[Profile], common: Resampling) -> Figures:
    if common.rules is None:
        return {}
    once = np.ones((1, common.weights.shape[1]), np.int64)
    rows = [
        evaluate_weighted(classes, weight, common.rules).total
        for weight in np.vstack([once, common.weights])
    ]
    present = np.ones(common.weights.shape[1], np.bool_)
    figures = {}
    for key in OFFICIAL:
        column = np.array([row[key.metric.lower()] for row in rows])
        figures[key] = Sampled(float(column[0]), column[1:], present)
    return figures


def _pooled(
    results: Sequence[SceneResult], config: ScoreConfig
) -> Iterator[tuple[MetricKey, Metric]]:
    counts = [scene_scores(result, ScoreFilter(""), config).clear for result in results]
    truth, switches = _column(c.truth for c in counts), _column(c.switches for c in counts)
    errors = _column(c.misses + c.false_positives + c.switches for c in counts)
    distance = _column(c.distance for c in counts)
    _, _, mota, motp, ids = OFFICIAL
    yield mota, Ratio(truth - errors, truth)
    yield motp, Ratio(distance, _column(c.matches + c.switches for c in counts))
    yield ids, Sum(switches)


def _velocity(
    results: Sequence[SceneResult], config: ScoreConfig, memo: Memo
) -> Iterator[tuple[MetricKey, Metric]]:
    samples = [memo(velocity_samples, result, config.velocity) for result in results]
    declared = {name for result in results for name in result.classes}
    masks = [category_masks(part, config.velocity, declared) for part in samples]
    rows = list(dict.fromkeys(row for mask in masks for row in mask))
    for row in rows:
        errors = [
            part.error_mps[mask[row]] if row in mask else np.zeros(0)
            for part, mask in zip(samples, masks, strict=True)
        ]
        if any(len(part) for part in errors):
            mean = Ratio(_column(e.sum() for e in errors), _column(len(e) for e in errors))
            yield MetricKey("velocity", row, "mean", "m/s"), mean
            yield MetricKey("velocity", row, "worst 5 %", "m/s"), TailMean.of(errors)


def _flow(results: Sequence[SceneResult]) -> Iterator[tuple[MetricKey, Metric]]:
    if not any(len(result.flow) for result in results):
        return
    for row in ("dynamic", "static", ALL):
        chosen = [result.flow.select(_cells(result.flow, row)) for result in results]
        cells = _column(len(part) for part in chosen)
        errors = [_speed_error(part) for part in chosen]
        squared_mps = _column((e**2).sum() for e in errors)
        shifts = [e * part.dt_s for e, part in zip(errors, chosen, strict=True)]
        squared_m = _column((s**2).sum() for s in shifts)
        angle = _column(angular_error(part).sum() for part in chosen)
        yield MetricKey("flow", row, "RMSE", "m/s"), Ratio(squared_mps, cells, root=True)
        yield MetricKey("flow", row, "RMSE of the flow", "m"), Ratio(squared_m, cells, root=True)
        yield MetricKey("flow", row, "AAE", "rad"), Ratio(angle, cells)


def _cells(flow: FlowSamples, row: str) -> Mask:
    masks = {"dynamic": flow.dynamic, "static": ~flow.dynamic}
    return masks.get(row, np.ones(len(flow), np.bool_))


def _speed_error(flow: FlowSamples) -> F64:
    error = flow.estimate_mps.astype(np.float64) - flow.truth_mps
    return np.hypot(error[:, 0], error[:, 1])


def _told_apart(results: Sequence[SceneResult]) -> bool:
    return any(np.isin(r.tracks.label, np.unique(r.truth.label)).any() for r in results)


def _column(values: Iterator[float] | Sequence[float]) -> F64:
    return np.array(list(values), np.float64)

"""All metrics of a run that a comparison reports, each resampled by scene."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.eval.arithmetic import mota, ratio
from mottrack.eval.evaluation import Evaluation, class_aware, counted_labels, nothing_in_range
from mottrack.eval.flow_error import FlowTable
from mottrack.eval.nuscenes.prepare import rules_for
from mottrack.eval.nuscenes.resampling import sampled_metrics
from mottrack.eval.nuscenes.rules import Rules
from mottrack.eval.paired import (
    RESAMPLES,
    WORST_SHARE,
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
from mottrack.eval.streams import Largest
from mottrack.eval.velocity_error import VelocityErrorConfig, VelocitySamples, category_masks

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
HELD_SHARE = 2.0 * WORST_SHARE
"""Of the errors, the largest ones: the tails of nearly all resamples lie among them."""


@dataclass(frozen=True)
class Resampling:
    """What the runs that are compared have in common."""

    weights: I64
    """(B, S) how often each scene counts in each resample."""
    rules: Rules | None
    """Of the class-aware evaluation; None where it is class-agnostic (clusters)."""

    @classmethod
    def of(cls, runs: Sequence[Evaluation], resamples: int = RESAMPLES) -> Resampling:
        """Draw resamples for runs over the same scenes, in the same order."""
        labels = counted_labels([scene for run in runs for scene in run.labels])
        agnostic = any(run.config.class_agnostic or not class_aware(run.labels) for run in runs)
        rules = None if agnostic or not labels else rules_for(labels)
        return cls(draw(len(runs[0].results), resamples), rules)


def run_metrics(run: Evaluation, common: Resampling) -> RunMetrics:
    """Return all metrics of a run, on the whole and on every resample.

    MOTA, MOTP and IDS are the official ones: means over the classes (IDS: the sum), each class at
    its best score, which is sought anew in every resample. Where the evaluation is class-agnostic
    they are those of all boxes together.
    """
    declared = {name for scene in run.labels for name in scene.declared}
    velocity = velocity_metrics(run.samples, run.config.velocity, declared, common.weights)
    metrics = dict(velocity) | dict(_flow(run.flow))
    sampled = {key: sample(metric, common.weights) for key, metric in metrics.items()}
    return _tracking(run, common) | sampled


def _tracking(run: Evaluation, common: Resampling) -> RunMetrics:
    if common.rules is None:
        return {key: sample(metric, common.weights) for key, metric in _pooled(run)}
    classes = run.profiles(common.rules)
    if nothing_in_range(classes):  # there is nothing to average
        return {}
    official = sampled_metrics(classes, common.weights, common.rules)[ALL]
    return {key: official[key.metric.lower()] for key in OFFICIAL}


def _pooled(run: Evaluation) -> Iterator[tuple[MetricKey, Metric]]:
    counts = run.pooled.scenes
    errors, truth = _column(c.errors for c in counts), _column(c.truth for c in counts)
    distance, hits = _column(c.distance for c in counts), _column(c.hits for c in counts)
    _, _, mota_key, motp_key, ids_key = OFFICIAL
    yield mota_key, Pooled(mota, (errors, truth))
    by_distance = run.config.match_by == "distance"
    yield motp_key if by_distance else IOU_DISTANCE, Pooled(ratio, (distance, hits))
    yield ids_key, Sum(_column(c.switches for c in counts))


def velocity_metrics(
    samples: Sequence[VelocitySamples],
    config: VelocityErrorConfig,
    declared: Collection[str],
    weights: I64,
) -> Iterator[tuple[MetricKey, Metric]]:
    """Yield mean and tail of the velocity error of every category that has tracks.

    Args:
        samples: of each of S scenes; read several times, and not held.
        config: what stands still, and what is vulnerable.
        declared: classes of the data set.
        weights: (B, S) the resamples that the tail is asked for.
    """
    masked = _Masked(samples, config, declared)
    sums: dict[str, F64] = {}
    counts: dict[str, I64] = {}
    for scene, rows in enumerate(masked.rows()):
        for row, errors in rows.items():
            sums.setdefault(row, np.zeros(len(samples)))[scene] = errors.sum()
            counts.setdefault(row, np.zeros(len(samples), np.int64))[scene] = len(errors)
    present = {row: count for row, count in counts.items() if count.any()}
    for row, tail in _tails(masked, present, weights).items():
        mean = Ratio(sums[row], present[row].astype(np.float64))
        yield MetricKey("velocity", row, "mean", "m/s"), mean
        yield MetricKey("velocity", row, "worst 5 %", "m/s"), tail


class _Masked(NamedTuple):
    """Errors of each scene by the row of the table that they belong to."""

    samples: Sequence[VelocitySamples]
    config: VelocityErrorConfig
    declared: Collection[str]

    def rows(self) -> Iterator[dict[str, F64]]:
        """Yield the errors of each scene by row."""
        for part in self.samples:
            masks = category_masks(part, self.config, self.declared)
            yield {row: part.error_mps[mask] for row, mask in masks.items()}


def _tails(masked: _Masked, counts: dict[str, I64], weights: I64) -> dict[str, TailMean]:
    """Return the tail of each row, for which only the largest errors are held.

    A resample that repeats a scene with large errors reaches further down than the tail of all
    scenes; where it is not reached, more is read.
    """
    found: dict[str, TailMean] = {}
    share = HELD_SHARE
    while missing := [row for row in counts if row not in found]:
        largest = {r: Largest(math.ceil(share * int(counts[r].sum()))) for r in missing}
        for scene, rows in enumerate(masked.rows()):
            for row in rows.keys() & largest.keys():
                largest[row].add(rows[row], scene)
        for row, kept in largest.items():
            tail = TailMean(*kept.ascending(), counts[row])
            if share >= 1.0 or tail.holds_tails(weights):
                found[row] = tail
        share *= 2.0
    return {row: found[row] for row in counts}


def _flow(table: FlowTable) -> Iterator[tuple[MetricKey, Metric]]:
    if not table.sampled:
        return
    for row in ("dynamic", "movable", "static", ALL):
        cells, speeds, lengths, angles = np.array(table.sums[row]).T.copy()
        yield MetricKey("flow", row, "RMSE", "m/s"), Ratio(speeds, cells, root=True)
        yield MetricKey("flow", row, "RMSE of the flow", "m"), Ratio(lengths, cells, root=True)
        yield MetricKey("flow", row, "AAE", "rad"), Ratio(angles, cells)


def _column(values: Iterable[float]) -> F64:
    return np.array(list(values), np.float64)

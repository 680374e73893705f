"""What the report draws of a run beyond its scores: curves, distributions, kinds of error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mottrack.core.arrays import F64, Mask
from mottrack.core.errors import InputError
from mottrack.core.result import SceneResult
from mottrack.eval.nuscenes.anatomy_report import ClassAnatomy, classify_errors
from mottrack.eval.nuscenes.from_results import prepare_results, rules_for
from mottrack.eval.nuscenes.levels import Curves
from mottrack.eval.nuscenes.summary import evaluate_prepared
from mottrack.eval.scores import ScoreFilter, best_threshold
from mottrack.eval.velocity_error import (
    VelocitySamples,
    category_masks,
    velocity_samples,
)
from mottrack.report.timing import Timing
from mottrack.runs.comparison import ScoredRun

CURVES = ("mota", "precision", "motp", "ids")
SHARES = np.linspace(0.0, 1.0, 101)
"""The quantiles by which a distribution is drawn."""


@dataclass(frozen=True)
class Analysis:
    """What the report draws of one run."""

    curves: dict[str, dict[str, list[float | None]]]
    """Class to the points of its recall curves; empty where classes are not told apart."""
    anatomy: dict[str, ClassAnatomy]
    velocity: dict[str, list[float]]
    """Category to the quantiles of its velocity error, m/s."""
    cuts: tuple[ScoreFilter, ...]
    """Which boxes the counts of errors are about."""
    timing: Timing | None

    @classmethod
    def of(cls, run: ScoredRun) -> Analysis:
        """Reads the run's results once."""
        results = [run.memo(SceneResult.where_labelled, result) for result in run.results]
        curves, anatomy, cuts = _by_class(results, list(run.scores.classes), run)
        return cls(curves, anatomy, _velocity(results, run), cuts, Timing.of(run.results))

    def as_dict(self) -> dict[str, Any]:
        """Plain data for the page's scripts."""
        return {
            "curves": self.curves,
            "anatomy": {label: part.counts for label, part in self.anatomy.items()},
            "velocity": self.velocity,
            "timing": self.timing and vars(self.timing),
        }


def _by_class(
    results: Sequence[SceneResult], labels: Sequence[str], run: ScoredRun
) -> tuple[
    dict[str, dict[str, list[float | None]]], dict[str, ClassAnatomy], tuple[ScoreFilter, ...]
]:
    everything = (ScoreFilter(""),)
    if not labels:
        return {}, {}, everything
    rules = rules_for(labels)
    try:
        prepared = run.memo(prepare_results, results, rules)
    except InputError:  # nothing in range on one side: there are no curves to draw
        return {}, {}, everything
    found = run.memo(evaluate_prepared, prepared, rules).curves
    cuts = tuple(
        ScoreFilter(label, best_threshold(found[label], run.config), range_m)
        for label, range_m in zip(rules.classes, rules.ranges_m, strict=True)
    )
    curves = {label: _curve(curve) for label, curve in found.items() if _reached(curve).any()}
    return curves, classify_errors(prepared, rules), cuts


def _reached(curve: Curves) -> Mask:
    reached: Mask = ~np.isnan(curve["confidence"])
    return reached


def _curve(curve: Curves) -> dict[str, list[float | None]]:
    """The reached levels, the lowest recall first."""
    rows = np.flatnonzero(_reached(curve))[::-1]
    hits = curve["tp"] + curve["ids"]
    with np.errstate(invalid="ignore", divide="ignore"):
        precision = hits / (hits + curve["fp"])
    columns = {**curve, "precision": precision, "asked": curve["recall_hypo"]}
    return {name: _plain(columns[name][rows]) for name in ("asked", "confidence", *CURVES)}


def _velocity(results: Sequence[SceneResult], run: ScoredRun) -> dict[str, list[float]]:
    config = run.config.velocity
    samples = VelocitySamples.stacked(
        [run.memo(velocity_samples, result, config) for result in results]
    )
    declared = {name for result in results for name in result.classes}
    masks = category_masks(samples, config, declared)
    return {
        row: np.quantile(samples.error_mps[mask], SHARES).round(4).tolist()
        for row, mask in masks.items()
        if mask.any()
    }


def _plain(values: F64) -> list[float | None]:
    return [None if np.isnan(v) else round(float(v), 5) for v in values]

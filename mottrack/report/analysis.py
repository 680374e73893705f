"""Data behind the plots of one run: recall curves, error distributions, error types, timing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mottrack.core.arrays import Mask
from mottrack.core.errors import InputError
from mottrack.core.result import SceneResult
from mottrack.eval.nuscenes.error_classes import ClassErrors, classify_errors
from mottrack.eval.nuscenes.metrics import Curves, evaluate_prepared
from mottrack.eval.nuscenes.prepare import prepare_results, rules_for
from mottrack.eval.scores import ScoreFilter, best_threshold, scored_part
from mottrack.eval.velocity_error import (
    VelocitySamples,
    category_masks,
    velocity_samples,
)
from mottrack.formats.strict_json import strict
from mottrack.report.timing import Timing
from mottrack.runs.comparison import ScoredRun

CURVES = ("mota", "precision", "motp", "ids")
QUANTILES = np.linspace(0.0, 1.0, 101)
"""Quantiles by which a distribution is drawn: whole per cent, finer than a pixel of the plot."""
Curve = dict[str, list[float | None]]
"""Columns of a recall curve by name."""


@dataclass(frozen=True)
class ClassAnalysis:
    """What is known class by class; empty where matching is not class-aware."""

    curves: dict[str, Curve] = field(default_factory=dict)
    """Class to its recall curves."""
    error_classes: dict[str, ClassErrors] = field(default_factory=dict)
    filters: tuple[ScoreFilter, ...] = (ScoreFilter(""),)
    """The boxes that the error counts are about."""

    @classmethod
    def of(cls, run: ScoredRun, results: Sequence[SceneResult]) -> ClassAnalysis:
        """Evaluate the classes of the scored results of a run by the official rules."""
        labels = list(run.scores.classes)
        if not labels:
            return cls()
        rules = rules_for(labels)
        try:
            prepared = run.memo(prepare_results, results, rules)
        except InputError:  # no box of truth or of tracks is in range: there are no curves
            return cls()
        found = run.memo(evaluate_prepared, prepared, rules).curves
        filters = tuple(
            ScoreFilter(label, best_threshold(found[label], run.config), range_m)
            for label, range_m in zip(rules.classes, rules.ranges_m, strict=True)
        )
        curves = {label: _curve(curve) for label, curve in found.items() if _reached(curve).any()}
        return cls(curves, classify_errors(prepared, rules), filters)


@dataclass(frozen=True)
class Analysis:
    """Data behind the plots of one run."""

    classes: ClassAnalysis
    velocity: dict[str, list[float]]
    """Category to the quantiles of its velocity error, m/s."""
    timing: Timing | None

    @classmethod
    def of(cls, run: ScoredRun) -> Analysis:
        """Analyse the stored results of a run."""
        scored = [run.memo(scored_part, result, run.config) for result in run.results]
        return cls(ClassAnalysis.of(run, scored), _velocity(run), Timing.of(run.latency))

    def as_dict(self) -> dict[str, Any]:
        """Return plain data for the scripts of the page."""
        return {
            "curves": self.classes.curves,
            "error_classes": {
                label: part.counts for label, part in self.classes.error_classes.items()
            },
            "velocity": self.velocity,
        }


def _reached(curve: Curves) -> Mask:
    return ~np.isnan(curve["confidence"])


def _curve(curve: Curves) -> Curve:
    """Return the recall levels that were reached, the lowest first."""
    rows = np.flatnonzero(_reached(curve))[::-1]
    hits = curve["tp"] + curve["ids"]
    with np.errstate(invalid="ignore", divide="ignore"):
        precision = hits / (hits + curve["fp"])
    columns = {**curve, "precision": precision, "requested": curve["recall_hypo"]}
    names = ("requested", *CURVES)
    plain: Curve = strict({n: [round(float(v), 5) for v in columns[n][rows]] for n in names})
    return plain


def _velocity(run: ScoredRun) -> dict[str, list[float]]:
    config = run.config.velocity
    parts = [run.memo(scored_part, result, run.config, truth=False) for result in run.results]
    samples = VelocitySamples.stacked([run.memo(velocity_samples, part, config) for part in parts])
    declared = {name for part in parts for name in part.classes}
    masks = category_masks(samples, config, declared)
    return {
        row: np.quantile(samples.error_mps[mask], QUANTILES).round(4).tolist()
        for row, mask in masks.items()
        if mask.any()
    }

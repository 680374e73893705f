"""Data behind the plots of one run: recall curves, error distributions, error types, timing."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mottrack.core.arrays import Mask
from mottrack.eval.evaluation import Evaluation
from mottrack.eval.nuscenes.error_counts import ClassErrors
from mottrack.eval.nuscenes.metrics import Curves
from mottrack.eval.scores import ScoreFilter
from mottrack.eval.streams import Wanted
from mottrack.eval.velocity_error import error_distributions
from mottrack.formats.strict_json import strict
from mottrack.report.timing import Timing
from mottrack.runs.comparison import ScoredRun

CURVES = ("mota", "precision", "motp", "ids")
QUANTILES = tuple(np.linspace(0.0, 1.0, 101).tolist())
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
    def of(cls, run: Evaluation) -> ClassAnalysis:
        """Evaluate the classes of a run by the official rules."""
        if run.official is None:
            return cls()
        found = run.official.curves
        curves = {label: _curve(curve) for label, curve in found.items() if _reached(curve).any()}
        return cls(curves, run.error_classes, tuple(run.filters))


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
        classes = ClassAnalysis.of(run.evaluation)
        return cls(classes, _velocity(run.evaluation), Timing.of(run.latency))

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


def _velocity(run: Evaluation) -> dict[str, list[float]]:
    declared = {name for scene in run.labels for name in scene.declared}
    asked = Wanted(quantiles=QUANTILES)
    found = error_distributions(run.samples, run.config.velocity, declared, asked)
    return {
        row: [round(errors.quantile(q), 4) for q in QUANTILES]
        for row, errors in found.items()
        if errors.size
    }

"""How many errors of each kind a class has, by range and speed, and what each kind costs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from mottrack.core.arrays import F64, Texts
from mottrack.eval.arithmetic import SPEED_EDGES_MPS, bins
from mottrack.eval.clear import MISSES
from mottrack.eval.nuscenes.boxes import BoxTable, Prepared
from mottrack.eval.nuscenes.error_classes import (
    FALSE_POSITIVES,
    KINDS,
    SWITCHES,
    Counts,
    ErrorClassifier,
    Errors,
    count_kinds,
    truth_speeds,
)
from mottrack.eval.nuscenes.metrics import Curves, Metrics, class_scenes
from mottrack.formats.text_table import aligned

GROUPS = {
    **{kind: (kind,) for kind in KINDS},
    "all misses": MISSES,
    "all false positives": FALSE_POSITIVES,
    "all switches": SWITCHES,
}
"""What AMOTA is evaluated without, name to kinds."""
RANGE_EDGES_M = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0, np.inf)
"""Rings of 10 m up to the largest range of any class."""


@dataclass(frozen=True, slots=True)
class ClassErrors:
    """The errors of a class at its level of best MOTA, and what each kind costs."""

    counts: Counts
    """Kind to number of errors."""
    by_range: dict[str, Counts]
    """Distance from the vehicle, of the true box or, for a false positive, the predicted one."""
    by_speed: dict[str, Counts]
    """Speed of the true box; false positives have none and are left out."""
    amota: float
    amota_without: dict[str, float]
    """Kind to AMOTA if there were no errors of that kind (see `amota_without`)."""


def classify_errors(parts: Iterable[Prepared], official: Metrics) -> dict[str, ClassErrors]:
    """Classify the errors of every class that has truth and reaches a recall level.

    Args:
        parts: the boxes of some scenes each; of each only counts are kept.
        official: the metrics of all these scenes together.
    """
    reached = {n: c for n, c in official.curves.items() if not np.isnan(c["confidence"]).all()}
    found = {name: _Counted(curves) for name, curves in reached.items()}
    for prepared in parts:
        speeds_mps = truth_speeds(prepared)
        for label, name in enumerate(official.rules.classes):
            if name in found:
                scenes = class_scenes(prepared, label, official.rules)
                classifier = ErrorClassifier.of(prepared, label, official.rules, scenes)
                own_mps = speeds_mps[prepared.truth.label == label]
                found[name].add(classifier, _ranges(prepared, label), own_mps)
    return {name: counted.result() for name, counted in found.items()}


class _Ranges(NamedTuple):
    """Distance of the boxes of a class from the vehicle, metres."""

    truth_m: F64
    """(G,)"""
    tracks_m: F64
    """(P,)"""

    def of(self, errors: Errors) -> F64:
        """Return the distance of each error, (E,)."""
        out = np.empty(len(errors.kind))
        has = errors.truth_row >= 0
        out[has] = self.truth_m[errors.truth_row[has]]
        out[~has] = self.tracks_m[errors.track_row[~has]]
        return out


class _Counted:
    """The errors of one class so far."""

    def __init__(self, curves: Curves) -> None:
        threshold = curves["confidence"]
        self._curves = curves
        self._best = float(threshold[int(np.nanargmax(curves["mota"]))])
        none = dict.fromkeys(KINDS, 0)
        reached = np.unique(threshold[~np.isnan(threshold)]).tolist()
        self._levels: dict[float, Counts] = {level: dict(none) for level in reached}
        self._counts: Counts = dict(none)
        self._by_range: dict[str, Counts] = {}
        self._by_speed: dict[str, Counts] = {}
        self._boxes = 0

    def add(self, classifier: ErrorClassifier, ranges: _Ranges, speeds_mps: F64) -> None:
        """Take some scenes; `speeds_mps` are those of the true boxes (G,)."""
        for level, counts in self._levels.items():
            _add(counts, classifier.errors(level).kind)
        best = classifier.errors(self._best)
        of_truth = best.truth_row >= 0
        speed_mps = np.full(len(of_truth), np.nan)
        speed_mps[of_truth] = speeds_mps[best.truth_row[of_truth]]
        by_speed = bins(speed_mps, SPEED_EDGES_MPS, "m/s")
        unknown = of_truth & np.isnan(speed_mps)
        if unknown.any():
            by_speed["unknown"] = unknown
        _add(self._counts, best.kind)
        for table, masks in (
            (self._by_range, bins(ranges.of(best), RANGE_EDGES_M, "m")),
            (self._by_speed, by_speed),
        ):
            for name, mask in masks.items():
                _add(table.setdefault(name, dict.fromkeys(KINDS, 0)), best.kind[mask])
        self._boxes += len(classifier.truth_frame)

    def result(self) -> ClassErrors:
        """Return the counts, and what each kind costs."""
        gained = (self._curves, self._levels, self._boxes)
        return ClassErrors(
            counts=self._counts,
            by_range=self._by_range,
            by_speed=self._by_speed,
            amota=amota_without((), *gained),
            amota_without={name: amota_without(kinds, *gained) for name, kinds in GROUPS.items()},
        )


def _add(counts: Counts, kinds: Texts) -> None:
    for kind, count in count_kinds(kinds).items():
        counts[kind] += count


def _ranges(prepared: Prepared, label: int) -> _Ranges:
    sides = (prepared.truth, prepared.tracks)
    return _Ranges(*(_range(prepared, boxes.select(boxes.label == label)) for boxes in sides))


def _range(prepared: Prepared, boxes: BoxTable) -> F64:
    apart = boxes.centre_m[:, :2] - prepared.samples.ego_xy_m[boxes.sample]
    return np.hypot(apart[:, 0], apart[:, 1])


def amota_without(
    kinds: tuple[str, ...], curves: Curves, levels: dict[float, Counts], boxes: int
) -> float:
    """Return AMOTA of a class without errors of these kinds, from the counts per level.

    The thresholds stay. Corrected misses and switches become true positives, corrected false
    positives are dropped. A recall level that was not reached counts 0 as before, unless the
    corrected counts at the lowest threshold reach it: then it has their MOTAR.
    """
    reached = np.flatnonzero(~np.isnan(curves["confidence"]))
    corrected = {
        level: _corrected(kinds, curves, level, levels[float(curves["confidence"][level])])
        for level in reached.tolist()
    }
    lowest = corrected[int(reached[0])]
    motar = []
    for level, recall in enumerate(curves["recall_hypo"].tolist()):
        tp, others = corrected.get(level, lowest)
        enough = level in corrected or tp / boxes >= recall
        motar.append(_motar(tp, others, boxes) if enough else 0.0)
    return float(np.mean(motar))


def _corrected(
    kinds: tuple[str, ...], curves: Curves, level: int, counts: Counts
) -> tuple[float, float]:
    """Return true positives and remaining errors of a level without errors of these kinds."""
    gained = sum(counts[k] for k in kinds if k not in FALSE_POSITIVES)
    removed = sum(counts[k] for k in kinds)
    errors = sum(float(curves[name][level]) for name in ("fn", "ids", "fp"))
    return float(curves["tp"][level]) + gained, errors - removed


def _motar(tp: float, errors: float, boxes: int) -> float:
    recall = tp / boxes
    return max(0.0, 1.0 - (errors - (1.0 - recall) * boxes) / tp) if tp else 0.0


def as_plain(errors: dict[str, ClassErrors]) -> dict[str, Any]:
    """Return the errors as plain dictionaries, for JSON."""
    return {name: asdict(part) for name, part in errors.items()}


def format_errors(errors: dict[str, ClassErrors]) -> str:
    """Return a line per kind of error: its number in each class, and the AMOTA gained without."""
    names = list(errors)
    lines = [["error", *names, *(f"+AMOTA {name}" for name in names)]]
    for kind in KINDS:
        gains = [errors[n].amota_without[kind] - errors[n].amota for n in names]
        counts = [str(errors[n].counts[kind]) for n in names]
        lines.append([kind, *counts, *(f"{gain:.3f}" for gain in gains)])
    return aligned(lines)

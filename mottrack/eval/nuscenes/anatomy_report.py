"""The error anatomy of a whole evaluation: by class, range and speed, and what each kind costs."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from mottrack.core.arrays import F64, Texts
from mottrack.eval.nuscenes.anatomy import (
    FALSE_POSITIVES,
    KINDS,
    MISSES,
    SWITCHES,
    ErrorClassifier,
    Errors,
    buckets,
    truth_speeds,
)
from mottrack.eval.nuscenes.boxes import BoxTable, Prepared
from mottrack.eval.nuscenes.kernel import Scenes
from mottrack.eval.nuscenes.levels import Curves, class_curves, class_scenes
from mottrack.eval.nuscenes.rules import Rules
from mottrack.formats.text_table import aligned

RANGE_EDGES_M = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0, np.inf)
SPEED_EDGES_MPS = (0.0, 0.2, 1.0, 3.0, 8.0, np.inf)
Counts = dict[str, int]


@dataclass(frozen=True, slots=True)
class ClassAnatomy:
    """The errors of a class at its level of best MOTA, and the worth of mending them."""

    counts: Counts
    """Kind to number of errors."""
    by_range: dict[str, Counts]
    """Distance from the vehicle, of the true box or, for a false positive, the predicted one."""
    by_speed: dict[str, Counts]
    """Speed of the true box; false positives have none and are left out."""
    amota: float
    amota_without: dict[str, float]
    """Kind to AMOTA if there were no errors of that kind (see `amota_without`)."""


def classify_errors(prepared: Prepared, rules: Rules) -> dict[str, ClassAnatomy]:
    """The anatomy of every class that has truth and reaches a recall level."""
    out = {}
    for label, name in enumerate(rules.classes):
        scenes = class_scenes(prepared, label, rules)
        curves = class_curves(scenes, rules)
        if not np.isnan(curves["confidence"]).all():
            anatomist = ErrorClassifier.of(prepared, label, rules, scenes)
            out[name] = _class_anatomy(prepared, label, (anatomist, scenes), curves)
    return out


def _class_anatomy(
    prepared: Prepared, label: int, tools: tuple[ErrorClassifier, Scenes], curves: Curves
) -> ClassAnatomy:
    anatomist, scenes = tools
    threshold = curves["confidence"]
    levels = {float(t): anatomist.errors(float(t)).count() for t in np.unique(threshold) if t == t}
    best = anatomist.errors(float(threshold[int(np.nanargmax(curves["mota"]))]))
    where = _places(prepared, label, best)
    speeds = truth_speeds(prepared)[prepared.truth.label == label]
    speed = np.where(best.truth_row >= 0, speeds[best.truth_row], np.nan)
    told = best.truth_row >= 0
    boxes = len(scenes.truth) - 1
    return ClassAnatomy(
        counts=best.count(),
        by_range={
            name: _counts(best.kind[mask])
            for name, mask in buckets(where, RANGE_EDGES_M, "m").items()
        },
        by_speed={
            name: _counts(best.kind[mask & told])
            for name, mask in buckets(speed, SPEED_EDGES_MPS, "m/s").items()
        },
        amota=amota_without((), curves, levels, boxes),
        amota_without={
            name: amota_without(kinds, curves, levels, boxes)
            for name, kinds in {
                **{kind: (kind,) for kind in KINDS},
                "all misses": MISSES,
                "all false positives": FALSE_POSITIVES,
                "all switches": SWITCHES,
            }.items()
        },
    )


def _counts(kinds: Texts) -> Counts:
    return {kind: int(np.count_nonzero(kinds == kind)) for kind in KINDS}


def _places(prepared: Prepared, label: int, errors: Errors) -> F64:
    """(E,) distance of each error from the vehicle."""
    truth, tracks = (
        _range(prepared, boxes.select(boxes.label == label))
        for boxes in (prepared.truth, prepared.tracks)
    )
    out = np.empty(len(errors.kind))
    has = errors.truth_row >= 0
    out[has] = truth[errors.truth_row[has]]
    out[~has] = tracks[errors.track_row[~has]]
    return out


def _range(prepared: Prepared, boxes: BoxTable) -> F64:
    apart = boxes.centre_m[:, :2] - prepared.samples.ego_xy_m[boxes.sample]
    distance: F64 = np.hypot(apart[:, 0], apart[:, 1])
    return distance


def amota_without(
    kinds: tuple[str, ...], curves: Curves, levels: dict[float, Counts], boxes: int
) -> float:
    """AMOTA of a class if errors of these kinds had not been made, from the counts per level.

    The thresholds stay. Mended misses and switches become true positives, mended false positives
    vanish. A recall level that was not reached counts 0 as before, unless the mended counts at the
    lowest threshold reach it: then it has their MOTAR.
    """
    reached = np.flatnonzero(~np.isnan(curves["confidence"]))
    mended = {
        level: _mended(kinds, curves, level, levels[float(curves["confidence"][level])])
        for level in reached.tolist()
    }
    lowest = mended[int(reached[0])]
    motar = []
    for level, recall in enumerate(curves["recall_hypo"].tolist()):
        tp, others = mended.get(level, lowest)
        enough = level in mended or tp / boxes >= recall
        motar.append(_motar(tp, others, boxes) if enough else 0.0)
    return float(np.mean(motar))


def _mended(
    kinds: tuple[str, ...], curves: Curves, level: int, counts: Counts
) -> tuple[float, float]:
    """True positives and all other errors of a level without errors of these kinds."""
    gained = sum(counts[k] for k in kinds if k not in FALSE_POSITIVES)
    gone = sum(counts[k] for k in kinds)
    errors = sum(float(curves[name][level]) for name in ("fn", "ids", "fp"))
    return float(curves["tp"][level]) + gained, errors - gone


def _motar(tp: float, errors: float, boxes: int) -> float:
    recall = tp / boxes
    return max(0.0, 1.0 - (errors - (1.0 - recall) * boxes) / tp) if tp else 0.0


def as_plain(anatomy: dict[str, ClassAnatomy]) -> dict[str, Any]:
    """The anatomy as plain dictionaries, for JSON."""
    return {
        name: {key: getattr(part, key) for key in part.__dataclass_fields__}
        for name, part in anatomy.items()
    }


def format_anatomy(anatomy: dict[str, ClassAnatomy]) -> str:
    """A line per kind of error: how many in each class, and the AMOTA gained without it."""
    names = list(anatomy)
    lines = [["error", *names, *(f"+AMOTA {name}" for name in names)]]
    for kind in KINDS:
        gains = [anatomy[n].amota_without[kind] - anatomy[n].amota for n in names]
        counts = [str(anatomy[n].counts[kind]) for n in names]
        lines.append([kind, *counts, *(f"{gain:.3f}" for gain in gains)])
    return aligned(lines)

"""Classification of the errors: kinds of miss, false positive and switch, and what each costs.

Misses of a true track that is hit at all are a late start (before the first hit), a gap (between
hits) or an early end (after the last hit); those of a track that is never hit are "never found".

False positives are, in this order: a duplicate (a true box of the class nearer than the gate, which
another box took), the wrong class (a true box of another class that near), a near miss (a true box
of the class within twice the gate), or background.

Switches, of an object from identity a to b: a swap if a is matched with another object in that
very frame; a take-over if b was matched with another object before; else a re-identification: b
is new.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from mottrack.core.arrays import F64, I64, Texts
from mottrack.eval.arithmetic import SPEED_EDGES_MPS, bins
from mottrack.eval.clear import MISSES, miss_kinds
from mottrack.eval.nuscenes.boxes import BoxTable, Prepared
from mottrack.eval.nuscenes.kernel import MISS, SWITCH, Scenes
from mottrack.eval.nuscenes.metrics import Curves, Metrics, class_scenes, run_at
from mottrack.eval.nuscenes.rules import Rules
from mottrack.formats.text_table import aligned

FALSE_POSITIVES = ("duplicate", "wrong class", "near miss", "background")
SWITCHES = ("swap", "take-over", "re-identification")
KINDS = (*MISSES, *FALSE_POSITIVES, *SWITCHES)
GROUPS = {
    **{kind: (kind,) for kind in KINDS},
    "all misses": MISSES,
    "all false positives": FALSE_POSITIVES,
    "all switches": SWITCHES,
}
"""What AMOTA is evaluated without, name to kinds."""
RANGE_EDGES_M = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0, np.inf)
"""Rings of 10 m up to the largest range of any class."""
_FRAME_APART_M = 1e5
"""Frames are laid side by side at this distance, far beyond the gate, to search the neighbours in
all of them at once."""
Counts = dict[str, int]


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors of one pass over one class, a row each."""

    kind: Texts
    """(E,) one of KINDS."""
    truth_row: I64
    """(E,) the true box, -1 for a false positive."""
    track_row: I64
    """(E,) the predicted box, -1 for a miss."""

    def count(self) -> dict[str, int]:
        """Return the number of errors of each kind."""
        return count_kinds(self.kind)


@dataclass(frozen=True, slots=True)
class ErrorClassifier:
    """Classifies the errors of passes over one class."""

    scenes: Scenes
    false_positive: Texts
    """(P,) the kind that each predicted box is, should it be a false positive: the same at every
    threshold."""
    truth_frame: I64
    """(G,) frame of each true box."""

    @classmethod
    def of(cls, prepared: Prepared, label: int, rules: Rules, scenes: Scenes) -> ErrorClassifier:
        """Prepare for class `label` of the data, laid out as `scenes`."""
        boxes = np.diff(scenes.frame["truth"])
        kinds = _false_positive_kinds(prepared, label, rules)
        return cls(scenes, kinds, np.repeat(np.arange(len(boxes)), boxes))

    def errors(self, threshold: float) -> Errors:
        """Return all errors at a score threshold."""
        run_at(self.scenes, threshold)
        truth = self.scenes.truth[:-1]
        missed = np.flatnonzero(truth["event"] == MISS)
        switched = np.flatnonzero(truth["event"] == SWITCH)
        false = self._false_positives(threshold)
        misses = miss_kinds(truth["object"], self.truth_frame, truth["event"] != MISS)
        kinds = [misses[missed], self.false_positive[false], self._switch_kinds(switched)]
        absent = [np.full(len(rows), -1) for rows in (missed, false)]
        return Errors(
            np.concatenate(kinds),
            np.concatenate([missed, absent[1], switched]),
            np.concatenate([absent[0], false, truth["match"][switched]]),
        )

    def _false_positives(self, threshold: float) -> I64:
        extra = self.scenes.track["score"][:-1] >= threshold
        match = self.scenes.truth["match"][:-1]
        extra[match[match >= 0]] = False
        return np.flatnonzero(extra)

    def _switch_kinds(self, switched: I64) -> Texts:
        truth = self.scenes.truth[:-1]
        rows = np.flatnonzero(truth["match"] >= 0)
        identity = np.full(len(truth), -1)
        identity[rows] = self.scenes.track["id"][truth["match"][rows]]
        before = _previous_identity(truth["object"], identity)
        present = set(zip(self.truth_frame[rows].tolist(), identity[rows].tolist(), strict=True))
        owners = _owners(identity[rows], truth["object"][rows], self.truth_frame[rows])
        kinds = []
        for row in switched.tolist():
            frame, new = int(self.truth_frame[row]), int(identity[row])
            others = owners.get(new, {}).items()
            taken = any(o != truth["object"][row] and first < frame for o, first in others)
            swapped = (frame, int(before[row])) in present
            kinds.append("swap" if swapped else "take-over" if taken else "re-identification")
        return np.array(kinds, np.str_)


def _previous_identity(objects: I64, identity: I64) -> I64:
    """Return the identity of the object's last hit before each true box (G,), -1 for none."""
    order = np.argsort(objects, kind="stable")
    before = np.full(len(order), -1)
    hits = order[identity[order] >= 0]
    same = objects[hits[1:]] == objects[hits[:-1]]
    before[hits[1:][same]] = identity[hits[:-1][same]]
    return before


def _owners(identity: I64, objects: I64, frame: I64) -> dict[int, dict[int, int]]:
    """Return, per identity matched with several objects, object to frame of its first match."""
    pairs, first = np.unique(np.stack([identity, objects]), axis=1, return_index=True)
    counts = np.unique(pairs[0], return_counts=True)
    several = set(counts[0][counts[1] > 1].tolist())
    owners: dict[int, dict[int, int]] = {}
    for (track, owner), row in zip(pairs.T.tolist(), first.tolist(), strict=True):
        if track in several:
            owners.setdefault(track, {})[owner] = int(frame[row])
    return owners


def _false_positive_kinds(prepared: Prepared, label: int, rules: Rules) -> Texts:
    tracks = prepared.tracks.select(prepared.tracks.label == label)
    same = prepared.truth.label == label
    gate = rules.match_distance_m
    own = _nearest(tracks, prepared.truth.select(same), 2 * gate)
    other = _nearest(tracks, prepared.truth.select(~same), gate)
    conditions = [own < gate, other < gate, own < 2 * gate]
    return np.select(conditions, ["duplicate", "wrong class", "near miss"], "background")


def _nearest(tracks: BoxTable, truth: BoxTable, limit_m: float) -> F64:
    """Return the distance to the nearest true box of the sample (P,), infinite beyond the limit."""
    if not len(tracks) or not len(truth):
        return np.full(len(tracks), np.inf)
    places = []
    for boxes in (truth, tracks):
        depth = boxes.sample * _FRAME_APART_M
        places.append(np.column_stack([boxes.centre_m[:, :2], depth]))
    return np.asarray(cKDTree(places[0]).query(places[1], distance_upper_bound=limit_m)[0])


def truth_speeds(prepared: Prepared) -> F64:
    """Return the speed of each true box (G,), m/s, from its neighbours; NaN for a single box."""
    truth, stamp = prepared.truth, prepared.samples.stamp_us
    order = np.argsort(truth.track, kind="stable")
    track, sample = truth.track[order], truth.sample[order]
    rows = np.arange(len(order))
    same = np.r_[False, track[1:] == track[:-1]]
    low = np.where(same, rows - 1, rows)
    high = np.where(np.r_[same[1:], False], rows + 1, rows)
    seconds = (stamp[sample[high]] - stamp[sample[low]]) / 1e6
    step = truth.centre_m[order[high], :2] - truth.centre_m[order[low], :2]
    speed = np.full(len(order), np.nan)
    moved = seconds > 0
    speed[order[moved]] = np.hypot(*step[moved].T) / seconds[moved]
    return speed


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


def count_kinds(kinds: Texts) -> Counts:
    """Return the number of errors of each kind."""
    return {kind: int(np.count_nonzero(kinds == kind)) for kind in KINDS}


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

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

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from mottrack.core.arrays import F64, I64, Texts
from mottrack.eval.clear import MISSES, miss_kinds
from mottrack.eval.nuscenes.boxes import BoxTable, Prepared
from mottrack.eval.nuscenes.kernel import MISS, SWITCH, Scenes
from mottrack.eval.nuscenes.metrics import run_at
from mottrack.eval.nuscenes.rules import Rules

FALSE_POSITIVES = ("duplicate", "wrong class", "near miss", "background")
SWITCHES = ("swap", "take-over", "re-identification")
KINDS = (*MISSES, *FALSE_POSITIVES, *SWITCHES)
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


def count_kinds(kinds: Texts) -> Counts:
    """Return the number of errors of each kind."""
    return {kind: int(np.count_nonzero(kinds == kind)) for kind in KINDS}

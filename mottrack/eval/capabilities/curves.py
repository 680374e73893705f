"""The curves: for every bin of a condition the mean of what happened, with its interval."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.eval.arithmetic import SPEED_EDGES_MPS
from mottrack.eval.capabilities.tracking import Scene, Side, Tracking, histories
from mottrack.eval.clear import Association
from mottrack.eval.flow_error import RANGE_EDGES_M
from mottrack.eval.paired import Ratio, draw, sample

LATENCIES_S = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0)
"""Key frames of nuScenes are half a second apart."""


class Events(NamedTuple):
    """N things that happened, each under a condition."""

    condition: F64
    """(N,)"""
    value: F64
    """(N,)"""


Measure = Callable[[Tracking, Association], Events]


@dataclass(frozen=True)
class Capability:
    """One curve's axes and how its events are found."""

    title: str
    condition: str
    """Name and unit of the axis along which it is drawn."""
    value: str
    edges: tuple[float, ...]
    events: Measure
    of_frames: Callable[..., F64] | None = None
    """Where events are frames: how the values of the classes become one, np.sum or np.max; their
    conditions are counts, and are added."""
    cumulative: bool = False
    """Whether an event counts in every bin from its own on: a condition is then a limit."""

    def bin_name(self, point: Point) -> str:
        """Return the bin of a point in words."""
        if self.cumulative:
            return f"within {point.low:g}"
        return f"[{point.low:g}, {point.high:g})"


def kept_over_gaps(tracking: Tracking, found: Association) -> Events:
    """Return, for every time an object was lost and found, whether its identity was the same.

    The condition is the time between its last box before the gap and the first one after it.
    """
    gaps, kept = [], []
    for rows in histories(tracking.truth):
        hit = rows[found.track_row[rows] >= 0]
        frame, track = tracking.truth.frame[hit], tracking.tracks.id[found.track_row[hit]]
        lost = np.diff(frame) > 1
        gaps.append(np.diff(tracking.stamp_s[frame])[lost])
        kept.append((track[1:] == track[:-1])[lost])
    return _events(gaps, kept)


def found_within(tracking: Tracking, found: Association) -> Events:
    """Return, for every object and time, whether it was output by then after its first return."""
    return _output_within(tracking, found, np.ones(len(tracking.truth.frame), np.bool_))


def found_after_detection(tracking: Tracking, found: Association) -> Events:
    """Return the same after its first detection, of every object that is detected at all."""
    if tracking.detected is None:
        return _events([], [])
    return _output_within(tracking, found, tracking.detected.track_row >= 0)


def _output_within(tracking: Tracking, found: Association, there: Mask) -> Events:
    """Count the time from the first of the true boxes (M,) that are `there`."""
    waits = []
    for rows in histories(tracking.truth):
        stamps = tracking.stamp_s[tracking.truth.frame[rows]]
        hit = found.track_row[rows] >= 0
        if there[rows].any():
            first_s = stamps[there[rows]][0]
            waits.append(stamps[hit][0] - first_s if hit.any() else np.inf)
    wait = np.array(waits)[:, None] * np.ones(len(LATENCIES_S))
    limit = np.broadcast_to(np.array(LATENCIES_S), wait.shape)
    # stamps jitter: an output in the frame of the limit counts
    return Events(limit.ravel(), (wait <= limit + _JITTER_S).ravel().astype(np.float64))


_JITTER_S = 0.05
"""Half the time between two sweeps at 10 Hz."""


def continued_beside(tracking: Tracking, found: Association) -> Events:
    """Return, for every matched box, whether the object has the same identity in the next frame.

    The condition is the distance to the nearest other true box.
    """
    nearest = _nearest_m(tracking)
    apart, kept = [], []
    for rows in histories(tracking.truth):
        frame, partner = tracking.truth.frame[rows], found.track_row[rows]
        follows = (np.diff(frame) == 1) & (partner[:-1] >= 0)
        track = np.append(tracking.tracks.id, -1)[partner]  # the last one is nobody's
        apart.append(nearest[rows[:-1]][follows])
        kept.append((track[1:] == track[:-1])[follows])
    return _events(apart, kept)


def _nearest_m(tracking: Tracking) -> F64:
    """Return the distance of each true box to the next one in its frame, infinite if alone."""
    nearest = np.full(len(tracking.truth.frame), np.inf)
    frame = tracking.truth.frame
    for rows in np.split(np.arange(len(frame)), np.flatnonzero(np.diff(frame)) + 1):
        xy_m = tracking.truth.xy_m[rows]
        apart = np.hypot(*(xy_m[:, None] - xy_m[None]).transpose(2, 0, 1))
        np.fill_diagonal(apart, np.inf)
        nearest[rows] = apart.min(axis=1, initial=np.inf)
    return nearest


def velocity_error_by(condition: Callable[[Tracking, I64, I64], F64]) -> Measure:
    """Return the measure of |v - v_true| of matched boxes by a condition of true and track rows."""

    def events(tracking: Tracking, found: Association) -> Events:
        row = np.flatnonzero(found.track_row >= 0)
        track = found.track_row[row]
        apart = tracking.tracks.velocity_mps[track] - tracking.truth.velocity_mps[row]
        error = np.asarray(np.hypot(*apart.T), np.float64)
        where = condition(tracking, row, track)
        known = np.isfinite(error) & np.isfinite(where)
        return Events(where[known], error[known])

    return events


def _age_s(tracking: Tracking, _row: I64, track: I64) -> F64:
    age = np.zeros(len(tracking.tracks.frame))
    for rows in histories(tracking.tracks):
        stamps = tracking.stamp_s[tracking.tracks.frame[rows]]
        age[rows] = stamps - stamps[0]
    return age[track]


def _range_m(tracking: Tracking, row: I64, _track: I64) -> F64:
    return tracking.truth.range_m[row]


def _speed_mps(tracking: Tracking, row: I64, _track: I64) -> F64:
    return np.asarray(np.hypot(*tracking.truth.velocity_mps[row].T))


def _points(tracking: Tracking, row: I64, _track: I64) -> F64:
    points = tracking.truth.points[row].astype(np.float64)
    return np.where(points >= 0, points, np.nan)


def false_by_crowd(tracking: Tracking, found: Association) -> Events:
    """Return the false track boxes of every frame by the number of its true boxes."""
    there = np.bincount(tracking.truth.frame, minlength=len(tracking.stamp_s))
    return Events(there.astype(np.float64), _unmatched(tracking, tracking.tracks, found))


def false_by_clutter(tracking: Tracking, found: Association) -> Events:
    """Return them by the number of false detections that the tracker received in the frame."""
    if tracking.objects is None or tracking.detected is None:
        return _events([], [])
    clutter = _unmatched(tracking, tracking.objects, tracking.detected)
    return Events(clutter, _unmatched(tracking, tracking.tracks, found))


def _unmatched(tracking: Tracking, side: Side, found: Association) -> F64:
    """Return how many boxes of each frame are matched with no true one, (T,)."""
    frames = len(tracking.stamp_s)
    hit = tracking.truth.frame[found.track_row >= 0]
    said = np.bincount(side.frame, minlength=frames)
    return (said - np.bincount(hit, minlength=frames)).astype(np.float64)


def time_by_load(tracking: Tracking, _found: Association) -> Events:
    """Return the tracker's milliseconds of every frame by the number of its track boxes."""
    if not len(tracking.tracker_s):
        return Events(np.zeros(0), np.zeros(0))
    load = np.bincount(tracking.tracks.frame, minlength=len(tracking.stamp_s))
    return Events(load.astype(np.float64), 1e3 * tracking.tracker_s)


def _events(conditions: Sequence[F64], values: Sequence[F64]) -> Events:
    none = np.zeros(0)
    return Events(
        np.concatenate([none, *conditions]), np.concatenate([none, *values]).astype(np.float64)
    )


_AGES_S = (0.0, 0.25, 0.75, 1.25, 1.75, 2.25, 3.25, 5.25, np.inf)
"""Between nuScenes' key frames; the first bin is the first box of a track."""
_ERROR = "mean error [m/s]"
CAPABILITIES = {
    "identity_over_gap": Capability(
        "Identity kept over a gap", "gap [s]", "share", (0.0, 0.75, 1.25, 2.25, 3.25, 5.25, np.inf),
        kept_over_gaps,
    ),
    "latency": Capability(
        "Output after the first return", "seconds", "share of objects", (*LATENCIES_S, np.inf),
        found_within, cumulative=True,
    ),
    "latency_of_detected": Capability(
        "Output after the first detection", "seconds", "share of detected objects",
        (*LATENCIES_S, np.inf), found_after_detection, cumulative=True,
    ),
    "neighbour": Capability(
        "Identity kept to the next frame", "distance of the nearest object [m]", "share",
        (0.0, 1.0, 2.0, 3.0, 5.0, 10.0, np.inf), continued_beside,
    ),
    "velocity_by_age": Capability(
        "Velocity error by age", "age of the track [s]", _ERROR, _AGES_S, velocity_error_by(_age_s)
    ),
    "velocity_by_range": Capability(
        "Velocity error by range", "range [m]", _ERROR, RANGE_EDGES_M, velocity_error_by(_range_m)
    ),
    "velocity_by_speed": Capability(
        "Velocity error by speed", "true speed [m/s]", _ERROR, SPEED_EDGES_MPS,
        velocity_error_by(_speed_mps),
    ),
    "velocity_by_points": Capability(
        "Velocity error by returns", "LiDAR returns", _ERROR, (0.0, 1.0, 5.0, 20.0, 100.0, np.inf),
        velocity_error_by(_points),
    ),
    "false_by_crowd": Capability(
        "False boxes by crowd", "true boxes in the frame", "false boxes a frame",
        (0.0, 1.0, 5.0, 10.0, 20.0, 40.0, np.inf), false_by_crowd, np.sum,
    ),
    "false_by_clutter": Capability(
        "False boxes by clutter", "false detections in the frame", "false boxes a frame",
        (0.0, 1.0, 5.0, 10.0, 20.0, 40.0, 80.0, np.inf), false_by_clutter, np.sum,
    ),
    "time_by_load": Capability(
        "Time by load", "tracks in the frame", "tracker [ms]",
        (0.0, 10.0, 20.0, 40.0, 80.0, 160.0, np.inf), time_by_load, np.max,
    ),
}  # fmt: skip


class Point(NamedTuple):
    """One bin of a curve."""

    low: float
    """Condition from, included."""
    high: float
    """Condition to, left out."""
    value: float
    """NaN where nothing happened."""
    interval: tuple[float, float]
    """95 % over scenes; NaN where there is none."""
    events: int


Curves = dict[str, list[Point]]


def curves(scenes: Sequence[Scene], resamples: int) -> Curves:
    """Return every curve of a run; one without any event is left out."""
    matched = [[_Matched(tracking, tracking.match()) for tracking in scene] for scene in scenes]
    weights = draw(len(scenes), resamples)
    found: Curves = {}
    for name, capability in CAPABILITIES.items():
        events = [_of_scene(capability, scene) for scene in matched]
        points = [
            _point(events, (low, high), weights)
            for low, high in zip(capability.edges, capability.edges[1:], strict=False)
        ]
        if any(point.events for point in points):
            found[name] = points
    return found


class _Matched(NamedTuple):
    """Boxes of one class in one scene, and which of them are matched."""

    tracking: Tracking
    association: Association


def _of_scene(capability: Capability, scene: Sequence[_Matched]) -> Events:
    """Return the events of all classes of a scene."""
    parts = [capability.events(*pair) for pair in scene]
    conditions, values = [part.condition for part in parts], [part.value for part in parts]
    if capability.of_frames is None or not parts:
        return _events(conditions, values)
    return Events(np.sum(conditions, axis=0), capability.of_frames(values, axis=0))


def _point(events: Sequence[Events], span: tuple[float, float], weights: I64) -> Point:
    values = [e.value[(e.condition >= span[0]) & (e.condition < span[1])] for e in events]
    sampled = sample(Ratio.mean(values), weights)
    return Point(*span, sampled.value, sampled.interval(), sum(map(len, values)))

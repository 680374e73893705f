"""What a measured velocity is worth to a tracker, on rows that all compared runs have.

AMOTA counts misses, false positives and switches alike, so a velocity shows little there. Beside it
stand, over the same (object, frame) rows of every run:

    velocity error     |v_track - v_true| in m/s, by category and by the age of the track
    1 s prediction     by how much a constant-velocity prediction of an object above 3 m/s misses:
                       |v_track - (p_true(t + 1 s) - p_true(t)) / 1 s| times 1 s, in metres
    share of headroom  (baseline - run) / (baseline - oracle), the oracle being the same tracker
                       with the true velocity

A row is common if every run has a track on that object in that frame (a track overlaps it by half,
see `velocity_error`; of several the nearest). By age only rows count whose track has the same age,
in published frames, in every run. Intervals come from resampled scenes (`paired`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mottrack.core import SceneResult
from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.tables import TruthTable
from mottrack.eval.paired import MetricKey, Ratio, Sampled, sample, t_interval
from mottrack.eval.velocity_error import FAST_MPS, VelocityErrorConfig, match_by_overlap

AGES = (1, 2, 3, 4)
"""Ages listed one by one; a velocity helps a filter most in the first three (DGMTrack, 2026)."""
HORIZON_S = 1.0
"""Of the prediction."""
HORIZON_TOLERANCE_S = 0.26
"""A frame this near to the horizon stands for it: half the time between nuScenes' key frames."""
TABLE = "value"
ALL, STATIONARY, SLOW, FAST = "all", "stationary", "slow", "fast"
OLDER = f"age over {AGES[-1]}"


@dataclass(frozen=True, slots=True)
class ObjectRows:
    """The true boxes of a scene that a run has a track on, N of M."""

    box: I64
    """(N,) row in the truth, ascending."""
    error_mps: F64
    """(N,) velocity error of the track."""
    age: I64
    """(N,) frames in which the track was published so far, this one included."""
    prediction_m: F64
    """(N,) error of the 1 s prediction; NaN where the object is slow or leaves the scene."""

    def at(self, box: I64) -> ObjectRows:
        """Return the rows of these true boxes, all of which are among its own."""
        rows = np.searchsorted(self.box, box)
        return ObjectRows(*(getattr(self, name)[rows] for name in self.__slots__))


class Value(NamedTuple):
    """A share, of the oracle's headroom or of the baseline; NaN ends where there is no interval."""

    metric: str
    share: float
    low: float
    high: float


def object_rows(result: SceneResult, config: VelocityErrorConfig) -> ObjectRows:
    """Return the matched true boxes of a scene with the error of their nearest track."""
    tracks, truth = result.tracks, result.truth
    matched = match_by_overlap(result, config.significant_overlap, config.revolution_s)
    reported = np.isfinite(tracks.velocity_mps).all(axis=1)
    rows = np.flatnonzero((matched >= 0) & (tracks.observed | config.coasting) & reported)
    apart_m = np.hypot(*(tracks.centre_m[rows, :2] - truth.centre_m[matched[rows], :2]).T)
    order = np.lexsort((apart_m, matched[rows]))
    box, first = np.unique(matched[rows][order], return_index=True)
    track = rows[order][first]
    velocity = tracks.velocity_mps[track]
    return ObjectRows(
        box=box,
        error_mps=np.hypot(*(velocity - truth.velocity_mps[box]).T),
        age=_ages(tracks.id, tracks.frame)[track],
        prediction_m=np.hypot(*(HORIZON_S * (velocity - _mean_velocity(result)[box])).T),
    )


def _ages(identity: I64, frame: I64) -> I64:
    """Return (N,) the number of rows of the same track up to each row."""
    order = np.lexsort((frame, identity))
    starts = np.r_[True, np.diff(identity[order]) != 0] if len(order) else np.zeros(0, np.bool_)
    first = np.maximum.accumulate(np.where(starts, np.arange(len(order)), 0))
    age = np.empty(len(order), np.int64)
    age[order] = np.arange(len(order)) - first + 1
    return age


def _mean_velocity(result: SceneResult) -> F64:
    """Return (M, 2) velocities over the next second; NaN where slow or not seen so long."""
    truth, stamp_s = result.truth, result.frames.stamp_ns * 1e-9
    mean = np.full((len(truth), 2), np.nan)
    ahead = np.abs(stamp_s[None] - stamp_s[:, None] - HORIZON_S)
    later = ahead.argmin(axis=1) if len(stamp_s) else np.zeros(0, np.int64)
    near = ahead.min(axis=1, initial=np.inf) <= HORIZON_TOLERANCE_S
    row_of = {(f, i): row for row, (f, i) in enumerate(_keys(truth))}
    fast = np.hypot(*truth.velocity_mps.T) > FAST_MPS
    for row in np.flatnonzero(fast & near[truth.frame]).tolist():
        frame = int(truth.frame[row])
        after = row_of.get((int(later[frame]), int(truth.id[row])))
        if after is not None:
            elapsed_s = stamp_s[later[frame]] - stamp_s[frame]
            mean[row] = (truth.centre_m[after, :2] - truth.centre_m[row, :2]) / elapsed_s
    return mean


def _keys(truth: TruthTable) -> Iterator[tuple[int, int]]:
    return zip(truth.frame.tolist(), truth.id.tolist(), strict=True)


def value_metrics(
    runs: Mapping[str, Sequence[SceneResult]], config: VelocityErrorConfig, weights: I64
) -> dict[str, dict[MetricKey, Sampled]]:
    """Return the metrics of each run over the common rows, on the whole and on every resample.

    Args:
        runs: results by the title of the run, of the same scenes in the same order; read once, and
            not held.
        config: what counts as the same object.
        weights: (B, S) how often each scene counts.
    """
    sums: dict[str, dict[MetricKey, list[_Sum]]] = {title: {} for title in runs}
    for results in zip(*runs.values(), strict=True):
        for title, found in zip(runs, _scene(results, config), strict=True):
            for key, errors in found.items():
                own = _Sum(float(errors.sum()), float(len(errors)))
                sums[title].setdefault(key, []).append(own)
    return {title: dict(_sampled(parts, weights)) for title, parts in sums.items()}


class _Sum(NamedTuple):
    """Of the errors of a scene."""

    total: float
    rows: float


def _scene(
    results: Sequence[SceneResult], config: VelocityErrorConfig
) -> Iterator[dict[MetricKey, F64]]:
    """Yield the errors of each run in the common rows of a scene, by metric."""
    rows = [object_rows(result, config) for result in results]
    box = _common([part.box for part in rows])
    joint = [part.at(box) for part in rows]
    same = _equal([part.age for part in joint])
    speed_mps = np.hypot(*results[0].truth.velocity_mps[box].T)
    for part in joint:
        yield dict(_errors(part, same, speed_mps, config))


def _errors(
    part: ObjectRows, same: Mask, speed_mps: F64, config: VelocityErrorConfig
) -> Iterator[tuple[MetricKey, F64]]:
    """Yield the errors of one run and scene by metric."""
    still = speed_mps <= config.stationary_mps
    masks = {
        ALL: np.ones(len(speed_mps), np.bool_),
        STATIONARY: still,
        SLOW: ~still & (speed_mps <= FAST_MPS),
        FAST: speed_mps > FAST_MPS,
        **{f"age {age}": same & (part.age == age) for age in AGES},
        OLDER: same & (part.age > AGES[-1]),
    }
    for name, mask in masks.items():
        yield MetricKey(TABLE, name, "velocity error", "m/s"), part.error_mps[mask]
    ahead_m = part.prediction_m[np.isfinite(part.prediction_m)]
    yield MetricKey(TABLE, FAST, "1 s prediction", "m"), ahead_m


def _common(boxes: Sequence[I64]) -> I64:
    shared = boxes[0]
    for other in boxes[1:]:
        shared = np.intersect1d(shared, other)
    return shared


def _equal(ages: Sequence[I64]) -> Mask:
    return np.asarray((np.stack(ages) == ages[0]).all(axis=0))


def _sampled(
    parts: Mapping[MetricKey, Sequence[_Sum]], weights: I64
) -> Iterator[tuple[MetricKey, Sampled]]:
    """Yield the metrics of one run that have data, from the sums of each scene."""
    for key, sums in parts.items():
        total, count = np.array(sums).T.copy()  # summed column by column
        if count.any():
            yield key, sample(Ratio(total, count), weights)


def headroom(metric: str, baseline: Sampled, run: Sampled, oracle: Sampled) -> Value | None:
    """Return the share of the oracle's headroom that a run recovers; None without headroom.

    Where the interval of the headroom itself contains zero the share means nothing.
    """
    scenes = int(np.count_nonzero(baseline.present & run.present & oracle.present))
    room, draws = oracle.value - baseline.value, oracle.draws - baseline.draws
    low, high = t_interval(room, draws, scenes)
    if not (low > 0.0 or high < 0.0):
        return None
    share = (run.value - baseline.value) / room
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(draws * room > 0.0, (run.draws - baseline.draws) / draws, np.nan)
    return Value(metric, share, *t_interval(share, shares, scenes))


def relative_change(metric: str, baseline: Sampled, run: Sampled) -> Value | None:
    """Return (run - baseline) / baseline; None where the baseline is not positive."""
    if not baseline.value > 0.0:
        return None
    scenes = int(np.count_nonzero(baseline.present & run.present))
    share = run.value / baseline.value - 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(baseline.draws > 0.0, run.draws / baseline.draws - 1.0, np.nan)
    return Value(metric, share, *t_interval(share, shares, scenes))

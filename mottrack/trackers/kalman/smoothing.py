"""Rauch-Tung-Striebel smoothing (1965) of finished tracks, for labels made offline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.core.errors import ConfigError
from mottrack.core.objects import Tracks
from mottrack.core.pose import wrap_angle
from mottrack.trackers.kalman.association import heading_residual
from mottrack.trackers.kalman.config import KalmanConfig
from mottrack.trackers.kalman.noise import NoiseTable, process_covariance
from mottrack.trackers.kalman.state import (
    POSE,
    RATE,
    SIZE,
    SMALLEST_SIZE_M,
    STATE_SIZE,
    VELOCITY,
    YAW,
)


class _Estimate(NamedTuple):
    """State of a track at a step."""

    step: int
    mean: F64
    """(11,)"""
    covariance: F64
    """(11, 11)"""
    observed: bool


class _Track(NamedTuple):
    """One identity, from its first detection to its last."""

    identity: int
    label: str
    score: float
    """Mean over its published rows."""
    estimates: list[_Estimate]


def smooth(steps: Sequence[Tracks], config: KalmanConfig | None = None) -> list[Tracks]:
    """Return the tracks of a finished scene, each state given all of its track's detections.

    A track is published at every step from its first detection to its last, gaps included;
    coasting after the last detection is cut off. Its score is the mean over its published rows, the
    same at every step.

    Args:
        steps: outputs of `KalmanTracker.step`, in order.
        config: that tracker's settings.

    Raises:
        ConfigError: the tracker counts in frames, whose length the smoother does not know.
    """
    config = config or KalmanConfig()
    if config.time == "frames":
        raise ConfigError("smoothing needs time in seconds, not frames")
    stamps_ns = np.array([step.stamp_ns for step in steps], np.int64)
    table = NoiseTable(config.noise)
    rows: list[list[_Row]] = [[] for _ in steps]
    for track in _tracks_of(steps):
        process = table.process(table.index(np.array([track.label])))
        model = _Model(process, stamps_ns, config.noise.form == "wiener")
        for estimate in model.smoothed(model.with_gaps_filled(track.estimates)):
            rows[estimate.step].append(_Row(track, estimate))
    return [_collect(step, found) for step, found in zip(steps, rows, strict=True)]


def _tracks_of(steps: Sequence[Tracks]) -> list[_Track]:
    places: dict[int, list[tuple[int, int]]] = {}
    for k, step in enumerate(steps):
        for row, identity in enumerate(step.id.tolist()):
            places.setdefault(identity, []).append((k, row))
    tracks = []
    for identity, found in places.items():
        while len(found) > 1 and not steps[found[-1][0]].observed[found[-1][1]]:
            found.pop()
        estimates = [
            _Estimate(k, steps[k].state[i], steps[k].covariance[i], bool(steps[k].observed[i]))
            for k, i in found
        ]
        score = float(np.mean([steps[k].score[i] for k, i in found]))
        first, row = found[0]
        tracks.append(_Track(identity, str(steps[first].label[row]), score, estimates))
    return tracks


@dataclass(frozen=True)
class _Model:
    """Constant velocity of one class over the steps of a scene."""

    process: F64
    """(1, 11) process noise per second."""
    stamps_ns: I64
    """(T,) of the steps."""
    wiener: bool

    def _predict(self, estimate: _Estimate, step: int) -> tuple[_Estimate, F64]:
        """Return the estimate carried to a later step, and the transition F (11, 11)."""
        dt_s = float(self.stamps_ns[step] - self.stamps_ns[estimate.step]) * 1e-9
        transition = np.eye(STATE_SIZE)
        transition[POSE, RATE] = dt_s * np.eye(4)
        growth = process_covariance(self.process, np.array([dt_s]), self.wiener)[0]
        covariance = transition @ estimate.covariance @ transition.T + growth
        return _Estimate(step, transition @ estimate.mean, covariance, observed=False), transition

    def with_gaps_filled(self, estimates: list[_Estimate]) -> list[_Estimate]:
        """Return the estimates with a prediction at every step in between that has none."""
        filled = [estimates[0]]
        for following in estimates[1:]:
            for step in range(filled[-1].step + 1, following.step):
                filled.append(self._predict(filled[-1], step)[0])
            filled.append(following)
        return filled

    def smoothed(self, estimates: list[_Estimate]) -> list[_Estimate]:
        """Return every estimate given all later ones as well.

        C = P F' (F P F' + Q)^-1, x^s = x + C (x^s_next - F x), P^s = P + C (P^s_next - P_next) C'.
        Not filterpy's smoother, which subtracts headings as plain numbers: here they are compared
        modulo pi, since the tracker may have flipped the heading in between.
        """
        smoothed = [estimates[-1]]
        for estimate in reversed(estimates[:-1]):
            later = smoothed[-1]
            predicted, transition = self._predict(estimate, later.step)
            gain = np.linalg.solve(predicted.covariance, transition @ estimate.covariance).T
            offset = later.mean - predicted.mean
            offset[YAW] = heading_residual(offset[YAW])
            mean = estimate.mean + gain @ offset
            mean[YAW] = wrap_angle(mean[YAW])
            spread = estimate.covariance + gain @ (later.covariance - predicted.covariance) @ gain.T
            smoothed.append(estimate._replace(mean=mean, covariance=0.5 * (spread + spread.T)))
        return smoothed[::-1]


class _Row(NamedTuple):
    """A smoothed estimate at one step, and the track that it belongs to."""

    track: _Track
    estimate: _Estimate


def _collect(step: Tracks, rows: list[_Row]) -> Tracks:
    if not rows:
        return Tracks.empty(step.stamp_ns, step.frame, STATE_SIZE)
    state = np.array([estimate.mean for _, estimate in rows])
    covariance = np.array([estimate.covariance for _, estimate in rows])
    return Tracks(
        stamp_ns=step.stamp_ns,
        frame=step.frame,
        centre_m=state[:, :3],
        size_m=np.maximum(state[:, SIZE], SMALLEST_SIZE_M),
        yaw_rad=state[:, YAW],
        label=np.array([track.label for track, _ in rows]),
        id=np.array([track.identity for track, _ in rows]),
        score=np.array([track.score for track, _ in rows]),
        velocity_mps=state[:, VELOCITY],
        velocity_covariance_m2ps2=covariance[:, VELOCITY, VELOCITY],
        state=state,
        covariance=covariance,
        observed=np.array([estimate.observed for _, estimate in rows]),
    )

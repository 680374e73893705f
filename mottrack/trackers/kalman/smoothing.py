"""Smoothing of finished tracks, for labels made offline: no gaps, and all detections count."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mottrack.core.errors import ConfigError
from mottrack.core.objects import Tracks
from mottrack.trackers.kalman.config import KalmanConfig
from mottrack.trackers.kalman.noise_table import NoiseTable
from mottrack.trackers.kalman.rts import Estimate, Motion, fill_gaps, rts
from mottrack.trackers.kalman.state import SIZE, SMALLEST_SIZE_M, VELOCITY, YAW

Place = tuple[int, int]
"""Step, and row in that step's tracks."""


def smooth(steps: Sequence[Tracks], config: KalmanConfig | None = None) -> list[Tracks]:
    """The tracks of a finished scene, each state given all of its track's detections.

    steps are the outputs of `KalmanTracker.step` in order, `config` that tracker's. A track is put
    out at every step from its first detection to its last, gaps included; what it coasted after
    the last is cut off. Its score is the mean over its detections, the same at every step.

    Raises:
        ConfigError: the tracker counted in frames or mixed models, which cannot be retraced.
    """
    config = config or KalmanConfig()
    if config.time == "frames" or config.motion.mixes():
        raise ConfigError("smoothing needs time in seconds and single motion models, no imm")
    stamps_ns = np.array([step.stamp_ns for step in steps], np.int64)
    table = NoiseTable(config.noise)
    rows: list[list[_Row]] = [[] for _ in steps]
    for identity, places in _by_identity(steps).items():
        track = _Track(identity, places, steps)
        motion = _motion(track.label, table, config)
        for estimate in rts(fill_gaps(track.estimates, stamps_ns, motion), stamps_ns, motion):
            rows[estimate.step].append(_Row(track, estimate))
    return [_collect(step, found) for step, found in zip(steps, rows, strict=True)]


class _Track:
    """One identity: its estimates up to its last detection."""

    def __init__(self, identity: int, places: list[Place], steps: Sequence[Tracks]) -> None:
        self.identity = identity
        first, row = places[0]
        self.label = str(steps[first].label[row])
        self.score = float(np.mean([steps[k].score[i] for k, i in places]))
        self.estimates = [
            Estimate(k, steps[k].state[i], steps[k].covariance[i], bool(steps[k].observed[i]))
            for k, i in places
        ]


class _Row:
    """One track at one step."""

    def __init__(self, track: _Track, estimate: Estimate) -> None:
        self.track, self.estimate = track, estimate


def _by_identity(steps: Sequence[Tracks]) -> dict[int, list[Place]]:
    """Where each identity is put out, from its first row to its last observed one."""
    found: dict[int, list[Place]] = {}
    for k, step in enumerate(steps):
        for row, identity in enumerate(step.id.tolist()):
            found.setdefault(identity, []).append((k, row))
    for places in found.values():
        while len(places) > 1 and not steps[places[-1][0]].observed[places[-1][1]]:
            places.pop()
    return found


def _motion(label: str, table: NoiseTable, config: KalmanConfig) -> Motion:
    index = table.index(np.array([label]))
    model = config.motion.classes.get(label, config.motion.default)
    return Motion(model, table.rows(index).process[0], config.noise.form == "wiener")


def _collect(step: Tracks, rows: list[_Row]) -> Tracks:
    if not rows:
        return Tracks.empty(step.stamp_ns, step.frame, step.state.shape[1])
    state = np.array([row.estimate.mean for row in rows])
    covariance = np.array([row.estimate.covariance for row in rows])
    return Tracks(
        stamp_ns=step.stamp_ns,
        frame=step.frame,
        centre_m=state[:, :3],
        size_m=np.maximum(state[:, SIZE], SMALLEST_SIZE_M),
        yaw_rad=state[:, YAW],
        label=np.array([row.track.label for row in rows]),
        id=np.array([row.track.identity for row in rows]),
        score=np.array([row.track.score for row in rows]),
        velocity_mps=state[:, VELOCITY],
        velocity_covariance_m2ps2=covariance[:, VELOCITY, VELOCITY],
        state=state,
        covariance=covariance,
        observed=np.array([row.estimate.observed for row in rows]),
    )

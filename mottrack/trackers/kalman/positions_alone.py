"""What a tracker would know of its tracks if no velocity was measured."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64, Mask
from mottrack.geometry.two_by_two import block_of
from mottrack.trackers.kalman.block_bank import Residual, correct_planar, predict_planar
from mottrack.trackers.kalman.config import KalmanConfig
from mottrack.trackers.kalman.detections import Detections
from mottrack.trackers.kalman.observations import Matched, Observation
from mottrack.trackers.kalman.standing import (
    Hypotheses,
    Rates,
    Standing,
    change,
    rates_of,
    weigh_position,
)
from mottrack.trackers.kalman.state import STATE_SIZE
from mottrack.trackers.velocity_source.evidence import (
    Known,
    believed,
    elapse,
    fade,
    judge,
    settle,
)


class Judged(NamedTuple):
    """What velocities are added to and judged by, as `velocity_source.evidence` reads it."""

    evidence: F64
    law: F64


class Tracked(NamedTuple):
    """Tracks of a tracker, N of them."""

    mean: F64
    """(N, 11)"""
    planar: F64
    """(N, 4, 4) covariances of (x, y, d_x, d_y)."""
    standing: Hypotheses


class Moved(NamedTuple):
    """What a step brings to all N tracks."""

    elapsed_s: F64
    """(N,)"""
    process: F64
    """(N, 11) process noise per `unit_s`."""
    unit_s: float
    """The tracker's unit of time."""


class _Velocities(NamedTuple):
    """Measured velocities of the detections of a step, and which were measured."""

    known: Mask
    measured: Observation


class _Model(NamedTuple):
    """How tracks move, as the compiled step reads it."""

    wiener: bool
    may_stand: bool
    """Whether the hypothesis that a track stands is in use."""
    rates: Rates


class PositionsAlone:
    """States and probabilities of standing of N tracks, corrected by positions alone.

    Beside the bank, which holds the measured velocities: an estimate that does not depend on them.
    Of the state only x, y, d_x, d_y are kept up.
    """

    def __init__(self, config: KalmanConfig) -> None:
        self._config = config.standing
        self._wiener = config.noise.form == "wiener"
        self._standing = Standing(config.standing)
        self.filters = np.zeros((0, STATE_SIZE)), np.zeros((0, 4, 4))
        """Means (N, 11) and covariances of (x, y, d_x, d_y) (N, 4, 4)."""

    @property
    def p_standing(self) -> F64:
        """(N,) probability that each track stands."""
        return self._standing.rows.p_standing

    def append(self, tracks: Tracked) -> None:
        """Add n tracks, all of whose numbers come from positions."""
        mean, planar = self.filters
        self.filters = np.concatenate([mean, tracks.mean]), np.concatenate([planar, tracks.planar])
        self._standing.append(*tracks.standing)

    def keep(self, mask: Mask) -> None:
        """Drop every track outside the mask (N,)."""
        mean, planar = self.filters
        self.filters = mean[mask], planar[mask]
        self._standing.keep(mask)

    def step(self, moved: Moved, matched: Matched, seen: Detections, judged: Judged) -> int:
        """Advance all tracks, correct those matched, judge velocities; return how many."""
        rates = rates_of(self._config, moved.unit_s)
        return _step(
            (*self._standing.rows, *self.filters),
            (moved.elapsed_s, moved.process, *matched),
            (seen.box, seen.xy_covariance, seen.velocity, seen.velocity_covariance),
            (seen.has_velocity, *judged),
            (self._wiener, self._config.use, moved.unit_s, *rates),
        )


@compiled
def _step(
    tracks: tuple[F64, F64, F64, F64, F64],
    step: tuple[F64, F64, I64, I64],
    seen: tuple[F64, F64, F64, F64],
    judged: tuple[Mask, F64, F64],
    model: tuple[bool, bool, float, float, float, float],
) -> int:
    """Predict tracks and let them start and stop; weigh positions and velocities, and correct.

    Plain tuples from outside: numba takes a microsecond and more to look at a named one.
    """
    rows, filters = Hypotheses(tracks[0], tracks[1], tracks[2]), (tracks[3], tracks[4])
    moved = Moved(step[0], step[1], model[2])
    matched, position = Matched(step[2], step[3]), Observation(seen[0], seen[1])
    how = _Model(model[0], model[1], Rates(model[3], model[4], model[5]))
    _predict(rows, filters, moved, how)
    if how.may_stand:
        weigh_position(rows, matched, position, filters)
    mean, work = filters[0], np.empty((4, 8))
    for m in range(len(matched.rows)):
        n, i = matched.rows[m], matched.columns[m]
        x, y = position.value[i, 0] - mean[n, 0], position.value[i, 1] - mean[n, 1]
        residual = Residual(x, y, block_of(position.covariance, i, 0))
        correct_planar(filters, n, 0, residual, work)
    longest_s = 0.0
    for n in range(len(moved.elapsed_s)):
        longest_s = max(longest_s, moved.elapsed_s[n])
    judging = Judged(judged[1], judged[2])
    elapse(judging.evidence, longest_s, believed(judging.law))
    velocity = _Velocities(judged[0], Observation(seen[2], seen[3]))
    return _judge(rows, filters, matched, velocity, judging)


@compiled
def _predict(rows: Hypotheses, filters: tuple[F64, F64], moved: Moved, how: _Model) -> None:
    for n in range(len(moved.elapsed_s)):
        predict_planar(filters, n, moved.process, moved.elapsed_s[n] / moved.unit_s, how.wiener)
    if how.may_stand:
        change(rows, filters, moved.elapsed_s, how.rates)


@compiled
def _judge(
    rows: Hypotheses,
    filters: tuple[F64, F64],
    matched: Matched,
    seen: _Velocities,
    judged: Judged,
) -> int:
    """Judge the velocities of matched tracks; return how many there were."""
    (mean, planar), evidence, law, count = filters, judged.evidence, believed(judged.law), 0
    for m in range(len(matched.rows)):
        n, i = matched.rows[m], matched.columns[m]
        if not seen.known[i]:
            continue
        if count == 0:
            fade(evidence)
        count += 1
        known = Known(mean[n, 7], mean[n, 8], block_of(planar, n, 2), rows.p_standing[n])
        v = seen.measured.value[i, 0], seen.measured.value[i, 1]
        judge(evidence, v, block_of(seen.measured.covariance, i, 0), known, law)
    if count > 0:
        settle(evidence, law)
    return count

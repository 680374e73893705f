"""What a tracker would know of its tracks if no velocity was measured."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, Mask
from mottrack.geometry.two_by_two import block_of
from mottrack.trackers.kalman.block_bank import Residual, correct_planar, predict_planar
from mottrack.trackers.kalman.config import KalmanConfig
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


class Tracked(NamedTuple):
    """Tracks of a tracker, N of them."""

    mean: F64
    """(N, 11)"""
    planar: F64
    """(N, 4, 4) covariances of (x, y, d_x, d_y)."""
    standing: Hypotheses


class MotionModel(NamedTuple):
    """How tracks move over a step."""

    wiener: bool
    """Process noise of a white acceleration, not of the diagonal alone."""
    may_stand: bool
    """Tracks start and stop."""
    unit_s: float
    """Time unit of the process noise."""
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

    def predict(self, elapsed_s: F64, process: F64, unit_s: float) -> None:
        """Advance over `elapsed_s` (N,), with process noise (N, 11) per `unit_s`."""
        rates = rates_of(self._config, unit_s)
        model = MotionModel(self._wiener, self._config.use, unit_s, rates)
        _predict(self._standing.rows, self.filters, elapsed_s, process, model)

    def observe(self, matched: Matched, position: Observation) -> None:
        """Correct matched tracks."""
        _observe(self._standing.rows, matched, position, self.filters, self._config.use)


@compiled
def _predict(
    rows: Hypotheses,
    filters: tuple[F64, F64],
    elapsed_s: F64,
    process: F64,
    model: MotionModel,
) -> None:
    """Predict, then let tracks start and stop."""
    for n in range(len(elapsed_s)):
        predict_planar(filters, n, process, elapsed_s[n] / model.unit_s, model.wiener)
    if model.may_stand:
        change(rows, filters, elapsed_s, model.rates)


@compiled
def _observe(
    rows: Hypotheses,
    matched: Matched,
    position: Observation,
    filters: tuple[F64, F64],
    may_stand: bool,
) -> None:
    """Weigh positions of matched tracks, then correct their states by them."""
    if may_stand:
        weigh_position(rows, matched, position, filters)
    mean, work = filters[0], np.empty((4, 8))
    for m in range(len(matched.rows)):
        n, i = matched.rows[m], matched.columns[m]
        x, y = position.value[i, 0] - mean[n, 0], position.value[i, 1] - mean[n, 1]
        residual = Residual(x, y, block_of(position.covariance, i, 0))
        correct_planar(filters, n, 0, residual, work)

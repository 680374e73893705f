"""What a tracker would know of its tracks if no velocity was measured."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64, Mask
from mottrack.trackers.kalman.block_bank import Blocks, correct_planar, predict_planar
from mottrack.trackers.kalman.config import KalmanConfig
from mottrack.trackers.kalman.standing import (
    Hypotheses,
    Observation,
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
        self._blocks = _blocks(np.zeros((0, STATE_SIZE)), np.zeros((0, 4, 4)))

    @property
    def filters(self) -> tuple[F64, F64]:
        """Means (N, 11) and covariances of (x, y, d_x, d_y) (N, 4, 4)."""
        return self._blocks.mean, self._blocks.planar

    @property
    def p_standing(self) -> F64:
        """(N,) probability that each track stands."""
        return self._standing.rows.p_standing

    def append(self, tracks: Tracked) -> None:
        """Add n tracks, all of whose numbers come from positions."""
        new = tracks.mean, tracks.planar
        joined = (np.concatenate(pair) for pair in zip(self.filters, new, strict=True))
        self._blocks = _blocks(*joined)
        self._standing.append(*tracks.standing)

    def keep(self, mask: Mask) -> None:
        """Drop every track outside the mask (N,)."""
        self._blocks = _blocks(*(part[mask] for part in self.filters))
        self._standing.keep(mask)

    def predict(self, elapsed_s: F64, process: F64, unit_s: float) -> None:
        """Advance over `elapsed_s` (N,), with process noise (N, 11) per `unit_s`."""
        rates = rates_of(self._config, unit_s)
        model = MotionModel(self._wiener, self._config.use, unit_s, rates)
        _predict(self._standing.rows, self.filters, elapsed_s, process, model)

    def observe(self, rows: I64, position: Observation) -> None:
        """Correct the tracks `rows` (n,)."""
        _observe(self._standing.rows, rows, position, self._blocks, self._config.use)


def _blocks(mean: F64, planar: F64) -> Blocks:
    return Blocks(mean, planar, np.zeros((0, 5)), np.zeros((0, 2)), np.zeros((0, 2)))


@compiled
def _predict(
    rows: Hypotheses,
    filters: tuple[F64, F64],
    elapsed_s: F64,
    process: F64,
    model: MotionModel,
) -> None:
    """Predict by F and Q of `noise.pair_growth`, then let tracks start and stop."""
    mean, planar = filters
    for n in range(len(mean)):
        t = elapsed_s[n] / model.unit_s
        predict_planar(planar[n], t)
        for k in range(2):
            mean[n, k] += t * mean[n, k + 7]
            p, q = process[n, k], process[n, k + 7]
            planar[n, k, k] += p * t
            planar[n, k + 2, k + 2] += q * t
            if model.wiener:
                planar[n, k, k] += q * t**3 / 3.0
                planar[n, k, k + 2] += q * t**2 / 2.0
                planar[n, k + 2, k] += q * t**2 / 2.0
    if model.may_stand:
        change(rows, filters, elapsed_s, model.rates)


@compiled
def _observe(
    rows: Hypotheses, chosen: I64, position: Observation, blocks: Blocks, may_stand: bool
) -> None:
    """Weigh positions (n,) of the tracks `chosen` (n,), then correct their states by them."""
    if may_stand:
        weigh_position(rows, chosen, position, (blocks.mean, blocks.planar))
    residual = np.empty((len(chosen), 2))
    for i in range(len(chosen)):
        for k in range(2):
            residual[i, k] = position.value[i, k] - blocks.mean[chosen[i], k]
    correct_planar(blocks, chosen, 0, residual, position.covariance)

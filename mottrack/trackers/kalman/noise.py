"""Noise of the filter as arrays, looked up by class, and its growth over a time step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64, Mask, Texts
from mottrack.core.errors import unknown_name
from mottrack.trackers.kalman.config import NoiseConfig
from mottrack.trackers.kalman.noise_tables import TABLES, UNKNOWN
from mottrack.trackers.kalman.state import BOX_SIZE, STATE_SIZE


@dataclass(frozen=True, slots=True)
class NoiseRows:
    """Noise parameters of N rows (tracks or detections)."""

    observation: F64
    """(N, 7) variances of the observed box."""
    lateral_ratio: F64
    """(N,) spread of a new velocity across the heading over that along it."""
    longitudinal_ratio: F64
    """(N,) standard deviation of the centre along the heading over that across it."""
    slip_rad: F64
    """(N,) standard deviation of a mover's heading about its course."""
    initial: F64
    """(N, 11) variances of a new state."""
    process: F64
    """(N, 11) growth per unit of time, of the seven box numbers and the four rates."""

    def select(self, index: NDArray[Any]) -> NoiseRows:
        """Return the rows that a mask or an index picks."""
        return NoiseRows(*(getattr(self, name)[index] for name in self.__slots__))


class NoiseTable:
    """Noise by class index; classes get an index when they are first seen."""

    def __init__(self, config: NoiseConfig) -> None:
        if config.table not in TABLES:
            raise unknown_name("noise table", config.table, TABLES)
        known = TABLES[config.table] | config.classes
        self.labels: list[str] = sorted(known)
        self._known = len(self.labels)
        self._classes = [known[label] for label in self.labels]
        self._pack()

    def index(self, label: Texts) -> I64:
        """Return the index (N,) of each label; an unseen one gets the noise of UNKNOWN."""
        names = label.tolist()
        try:
            return np.array([self._position[name] for name in names], np.int64)
        except KeyError:
            for name in sorted(set(names) - self._position.keys()):
                self.labels.append(name)
                self._classes.append(UNKNOWN)
            self._pack()
        return self.index(label)

    def names(self, index: I64) -> Texts:
        """Return the labels (N,) of those class indices."""
        return np.asarray(self._names[index])

    def knows(self, label: Texts) -> Mask:
        """Return whether each label (N,) has noise of its own."""
        return np.isin(label, self.labels[: self._known])

    def rows(self, index: I64) -> NoiseRows:
        """Return the noise of rows with those class indices (N,)."""
        packed = self._packed
        return NoiseRows(*(getattr(packed, name).take(index, axis=0) for name in packed.__slots__))

    def process(self, index: I64) -> F64:
        """Return the process noise (N, 11) per unit of time of those class indices (N,)."""
        return self._packed.process[index]

    def slip_rad(self, index: I64) -> F64:
        """Return the spread (N,) of a mover's heading about its course of those classes (N,)."""
        return self._packed.slip_rad[index]

    def _pack(self) -> None:
        rows = self._classes
        self._position = {name: k for k, name in enumerate(self.labels)}
        self._names = np.array(self.labels)
        self._packed = NoiseRows(
            observation=np.array([r.observation for r in rows]),
            lateral_ratio=np.array([r.lateral_ratio for r in rows]),
            longitudinal_ratio=np.array([r.longitudinal_ratio for r in rows]),
            slip_rad=np.array([r.slip_rad for r in rows]),
            initial=np.array([r.initial for r in rows]),
            process=np.array([r.process for r in rows]),
        )


def position_covariance(noise: NoiseRows, yaw_rad: F64) -> F64:
    """Return the covariance (N, 2, 2) of the observed centre, stretched along the heading."""
    variance = noise.observation[:, :2]
    if (noise.longitudinal_ratio == 1.0).all():
        return _diagonal(variance)
    mean = 0.5 * (variance[:, 0] + variance[:, 1])
    return _aligned(noise.longitudinal_ratio**2 * mean, mean, yaw_rad)


def initial_velocity_covariance(noise: NoiseRows, yaw_rad: F64) -> F64:
    """Return the covariance (N, 2, 2) of a new track's velocity: wide along the heading."""
    variance = noise.initial[:, 7:9]
    if (noise.lateral_ratio == 1.0).all():
        return _diagonal(variance)
    mean = 0.5 * (variance[:, 0] + variance[:, 1])
    return _aligned(mean, noise.lateral_ratio**2 * mean, yaw_rad)


def _diagonal(variance: F64) -> F64:
    return variance[:, :, None] * np.eye(2)


@compiled
def _aligned(longitudinal: F64, lateral: F64, yaw_rad: F64) -> F64:
    """Return covariances with these variances (N,) along and across the headings (N,)."""
    covariance = np.empty((len(yaw_rad), 2, 2))
    for n in range(len(yaw_rad)):
        cos, sin, stretch = np.cos(yaw_rad[n]), np.sin(yaw_rad[n]), longitudinal[n] - lateral[n]
        covariance[n, 0, 0] = lateral[n] + stretch * cos * cos
        covariance[n, 1, 1] = lateral[n] + stretch * sin * sin
        covariance[n, 0, 1] = covariance[n, 1, 0] = stretch * cos * sin
    return covariance


class PairGrowth(NamedTuple):
    """Process noise over a step of the four pairs (position, rate) of x, y, z, yaw; (N, 4) each."""

    position: F64
    both: F64
    """Covariance of the position with its rate."""
    rate: F64


def pair_growth(process: F64, dt_s: F64, wiener: bool) -> PairGrowth:
    """Return the process noise of the four (position, rate) pairs over steps dt_s (N,).

    Continuous white noise (`wiener`), p on the position and q on the rate:
    Q = [[p t + q t^3 / 3, q t^2 / 2], [q t^2 / 2, q t]]. Otherwise Q = diag(p, q) t, which for
    t = 1 frame is the published diagonal. `process` (N, 11) is per unit of time.
    """
    dt = dt_s[:, None]
    p, q = process[:, :4], process[:, 7:11]
    if not wiener:
        return PairGrowth(p * dt, np.zeros_like(q), q * dt)
    return PairGrowth(p * dt + q * dt**3 / 3.0, q * dt**2 / 2.0, q * dt)


def process_covariance(process: F64, dt_s: F64, wiener: bool) -> F64:
    """Return Q (N, 11, 11) over steps dt_s (N,); `process` (N, 11) per unit of time."""
    full = np.zeros((len(process), STATE_SIZE, STATE_SIZE))
    growth = pair_growth(process, dt_s, wiener)
    pair, size = np.arange(4), np.arange(4, BOX_SIZE)
    full[:, pair, pair], full[:, pair + 7, pair + 7] = growth.position, growth.rate
    full[:, pair, pair + 7] = full[:, pair + 7, pair] = growth.both
    full[:, size, size] = process[:, 4:7] * dt_s[:, None]
    return full

"""Reference engine: a batched Kalman filter and the Rauch-Tung-Striebel smoother.

Written from the textbook form and without a factor graph, so that it is an independent check of the
GTSAM engine. It is also the engine where there is no GTSAM (Windows).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64, Mask
from mottrack.trackers.fixed_lag.config import MotionModelConfig
from mottrack.trackers.fixed_lag.engine import FixedLagEngine, Recent
from mottrack.trackers.fixed_lag.motion import process_noise, transition
from mottrack.trackers.fixed_lag.nodes import NodeBatch


class Filtered(NamedTuple):
    """Filtered and predicted states of N nodes, and the smoothing gain between them."""

    mean: F64
    """(N, 6) given measurements up to this node."""
    covariance: F64
    """(N, 6, 6)."""
    predicted_mean: F64
    """(N, 6) given measurements up to the node before."""
    predicted_covariance: F64
    """(N, 6, 6)."""
    gain: F64
    """(N, 6, 6) smoothing gain `P F^T P_pred^-1` of the node before."""


class Step(NamedTuple):
    """Nodes (N,), the anchors of their tracks (N, 2) and the time since the node before (N,)."""

    batch: NodeBatch
    anchor_m: F64
    dt_s: F64

    def select(self, rows: NDArray[Any]) -> Step:
        """Return the nodes that a mask or an index picks."""
        return Step(self.batch.select(rows), self.anchor_m[rows], self.dt_s[rows])


class NumpyEngine(FixedLagEngine[Step]):
    """Fixed-lag smoothing by filter and smoother recursions."""

    def __init__(self, model: MotionModelConfig, lag_ns: int) -> None:
        matrices = ("covariance", "predicted_covariance", "gain")
        tails = {name: (6, 6) if name in matrices else (6,) for name in Filtered._fields}
        super().__init__(model, lag_ns, {name: (np.float64, tail) for name, tail in tails.items()})

    def _prepare(self, batch: NodeBatch, anchor_m: F64, dt_s: F64) -> Step:
        return Step(batch, anchor_m, dt_s)

    def _advance(self, nodes: Step, slots: I64, column: I64) -> Mask:
        before = self.store.before(column)
        mean, covariance = (self.store[name][slots, before] for name in ("mean", "covariance"))
        found = self._filter(nodes, mean, covariance)
        for name, array in found._asdict().items():
            self.store[name][slots, column] = array
        self._mean[slots], self._covariance[slots] = found.mean, found.covariance
        return np.ones(len(slots), np.bool_)

    def _filter(self, nodes: Step, mean: F64, covariance: F64) -> Filtered:
        """Predict and update every row by one step."""
        batch, dt_s = nodes.batch, nodes.dt_s
        step = transition(dt_s)
        predicted = np.einsum("nij,nj->ni", step, mean)
        crossed = step @ covariance
        spread = crossed @ step.transpose(0, 2, 1) + process_noise(dt_s, self.model)
        born = batch.birth
        position = batch.position_m - nodes.anchor_m
        noise = batch.position_covariance_m2 / batch.weight[:, :1, None]
        predicted[born] = 0.0
        predicted[born, :2] = position[born]
        spread[born] = _birth_covariance(self.model)
        spread[born, :2, :2] = noise[born]
        gain = np.zeros_like(spread)
        gain[~born] = np.linalg.solve(spread[~born], crossed[~born]).transpose(0, 2, 1)
        state = (predicted.copy(), spread.copy())
        _update(state, np.nonzero(~born)[0], (position, noise), 0)
        spread_v = batch.velocity_covariance_m2ps2 / batch.weight[:, 1:, None]
        velocity = (batch.velocity_mps, spread_v)
        _update(state, np.nonzero(batch.has_velocity)[0], velocity, 2)
        return Filtered(*state, predicted, spread, gain)

    def smoothed(self, recent: Recent) -> F64:
        """Return means (N, D, 6) by the backward recursion; see `FixedLagEngine.smoothed`."""
        slots, column = recent.slots, recent.column
        mean: F64 = self.store["mean"][slots[:, None], column]
        for k in range(column.shape[1] - 2, -1, -1):
            gain = self.store["gain"][slots, column[:, k + 1]]
            off = mean[:, k + 1] - self.store["predicted_mean"][slots, column[:, k + 1]]
            mean[:, k] += np.einsum("nij,nj->ni", gain, off)
        return mean

    def _smoothed_covariance(self, slot: int, column: I64) -> F64:
        spread: F64 = self.store["covariance"][slot, column]
        for k in range(len(column) - 2, -1, -1):
            gain = self.store["gain"][slot, column[k + 1]]
            change = spread[k + 1] - self.store["predicted_covariance"][slot, column[k + 1]]
            spread[k] += gain @ change @ gain.T
        return spread


def _birth_covariance(model: MotionModelConfig) -> F64:
    sigma = (
        [0.0, 0.0] + [model.birth_speed_sigma_mps] * 2 + [model.birth_acceleration_sigma_mps2] * 2
    )
    return np.diag(np.square(sigma))


def _update(state: tuple[F64, F64], rows: I64, measured: tuple[F64, F64], first: int) -> None:
    """Update states in place by components `first` and `first + 1`, in Joseph's form."""
    if len(rows) == 0:
        return
    mean, covariance = state
    value, noise = measured[0][rows], measured[1][rows]
    prior = covariance[rows]
    cross = prior[:, :, first : first + 2]
    spread = cross[:, first : first + 2] + noise
    gain = np.linalg.solve(spread, cross.transpose(0, 2, 1)).transpose(0, 2, 1)
    off = value - mean[rows, first : first + 2]
    mean[rows] += np.einsum("nij,nj->ni", gain, off)
    keep = np.broadcast_to(np.eye(6), prior.shape).copy()
    keep[:, :, first : first + 2] -= gain
    kept = keep @ prior @ keep.transpose(0, 2, 1)
    covariance[rows] = kept + gain @ noise @ gain.transpose(0, 2, 1)

"""The reference engine: a batched Kalman filter, and the smoother of Rauch, Tung and Striebel.

Written from the textbook form and without a factor graph, so that agreement with the GTSAM engine
means something. It is also the engine where there is no GTSAM (Windows).
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mottrack.trackers.fixed_lag.engine import FixedLagEngine, stacked
from mottrack.trackers.fixed_lag.motion import F64, MotionNoise, process_noise, transition
from mottrack.trackers.fixed_lag.nodes import NodeBatch


class Filtered(NamedTuple):
    """What the smoother needs of one node: filtered, predicted, and the gain that joins them."""

    mean: F64
    """(6,) given measurements up to this node."""
    covariance: F64
    """(6, 6)."""
    predicted_mean: F64
    """(6,) given measurements up to the node before."""
    predicted_covariance: F64
    """(6, 6)."""
    gain: F64
    """(6, 6) smoothing gain `P F^T P_pred^-1` of the node before."""


class NumpyEngine(FixedLagEngine):
    """Fixed-lag smoothing by filter and smoother recursions."""

    def __init__(self, noise: MotionNoise, lag_ns: int) -> None:
        super().__init__(noise, lag_ns)
        self._history: dict[int, deque[Filtered]] = {}

    def _advance(self, batch: NodeBatch, dt_s: F64) -> NDArray[np.bool_]:
        prior = (self._mean[batch.slot], self._covariance[batch.slot])
        nodes = self._filter(batch, dt_s, *prior)
        self._mean[batch.slot], self._covariance[batch.slot] = nodes.mean, nodes.covariance
        for row, slot in enumerate(batch.slot.tolist()):
            if batch.birth[row]:
                self._history[slot] = deque()
            self._history[slot].append(Filtered(*(array[row] for array in nodes)))
        return np.ones(len(batch), np.bool_)

    def _filter(self, batch: NodeBatch, dt_s: F64, mean: F64, covariance: F64) -> Filtered:
        """One step for every row: arrays with a leading axis N."""
        step = transition(dt_s)
        predicted = np.einsum("nij,nj->ni", step, mean)
        crossed = step @ covariance
        spread = crossed @ step.transpose(0, 2, 1) + process_noise(dt_s, self.noise)
        born = batch.birth
        position = batch.position_m - self._anchor_m[batch.slot]
        noise = batch.position_covariance_m2 / batch.weight[:, :1, None]
        predicted[born] = 0.0
        predicted[born, :2] = position[born]
        spread[born] = _birth_covariance(self.noise)
        spread[born, :2, :2] = noise[born]
        gain = np.zeros_like(spread)
        gain[~born] = np.linalg.solve(spread[~born], crossed[~born]).transpose(0, 2, 1)
        state = (predicted.copy(), spread.copy())
        _update(state, np.nonzero(~born)[0], (position, noise), 0)
        spread_v = batch.velocity_covariance_m2ps2 / batch.weight[:, 1:, None]
        velocity = (batch.velocity_mps, spread_v)
        _update(state, np.nonzero(batch.has_velocity)[0], velocity, 2)
        return Filtered(*state, predicted, spread, gain)

    def _drop_oldest(self, slot: int) -> None:
        self._history[slot].popleft()

    def _forget(self, slot: int) -> None:
        del self._history[slot]

    def _smooth(self, slot: int, covariance: bool) -> tuple[F64, F64 | None]:
        nodes = self._history[slot]
        mean = np.array([node.mean for node in nodes])
        spread = np.array([node.covariance for node in nodes])
        for k in range(len(nodes) - 2, -1, -1):
            later = nodes[k + 1]
            mean[k] += later.gain @ (mean[k + 1] - later.predicted_mean)
            change = spread[k + 1] - later.predicted_covariance
            spread[k] += later.gain @ change @ later.gain.T
        return mean, spread if covariance else None

    def _resolve(self, slots: list[int]) -> None:
        for slot in slots:
            nodes = list(self._windows[slot])
            history: deque[Filtered] = deque()
            if not nodes[0].is_birth:
                history.append(self._history[slot][0])
            for node in nodes[len(history) :]:
                prior = (np.zeros((1, 6)), np.eye(6)[None])
                if history:
                    prior = (history[-1].mean[None], history[-1].covariance[None])
                one = replace(stacked([node]), slot=np.array([slot]))
                filtered = self._filter(one, np.array([node.dt_s]), *prior)
                history.append(Filtered(*(array[0] for array in filtered)))
            self._history[slot] = history
            self._mean[slot], self._covariance[slot] = history[-1].mean, history[-1].covariance


def _birth_covariance(noise: MotionNoise) -> F64:
    sigma = (
        [0.0, 0.0] + [noise.birth_speed_sigma_mps] * 2 + [noise.birth_acceleration_sigma_mps2] * 2
    )
    return np.diag(np.square(sigma))


def _update(
    state: tuple[F64, F64], rows: NDArray[np.int64], measured: tuple[F64, F64], first: int
) -> None:
    """Kalman update in place with components `first` and `first + 1`, in Joseph's form."""
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

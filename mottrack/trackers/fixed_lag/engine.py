"""What both engines of the fixed-lag smoother share: slots, windows, anchors and checks.

A chain of linear Gaussian factors is eliminated from the oldest state to the newest. Each step
leaves the conditional `p(x_k | x_k+1, z_1..k)`, which later measurements do not change; so dropping
the oldest conditional of a window is exact marginalisation, and the newest state equals that of
the Kalman filter. The window adds what a filter cannot give: smoothed history, and a second look
at measurements that turned out to be outliers.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mottrack.core.errors import InputError
from mottrack.trackers.fixed_lag.motion import F64, STATE_DIM, MotionNoise, predict
from mottrack.trackers.fixed_lag.nodes import NodeBatch

Slots = NDArray[np.int64]


class Node(NamedTuple):
    """One state of a window: the batch and the row that hold its measurement."""

    batch: NodeBatch
    row: int
    dt_s: float
    """Time since the previous node of the track; 0 at birth."""
    weight: F64
    """(2,) robust weights of the position and the velocity factor."""

    surprise: float
    """Larger normalised distance of position and velocity from the prediction at arrival."""

    @property
    def is_birth(self) -> bool:
        """Whether the track begins here."""
        return bool(self.batch.birth[self.row])


def stacked(nodes: list[Node]) -> NodeBatch:
    """The measurements of many nodes as one batch, to be whitened together.

    Its slots number the rows and do not name tracks.
    """

    def rows(name: str) -> F64:
        return np.array([getattr(node.batch, name)[node.row] for node in nodes])

    return NodeBatch(
        stamp_ns=nodes[-1].batch.stamp_ns,
        slot=np.arange(len(nodes)),
        birth=rows("birth").astype(np.bool_),
        position_m=rows("position_m"),
        position_covariance_m2=rows("position_covariance_m2"),
        velocity_mps=rows("velocity_mps"),
        velocity_covariance_m2ps2=rows("velocity_covariance_m2ps2"),
        has_velocity=rows("has_velocity").astype(np.bool_),
        weight=np.array([node.weight for node in nodes]),
        innovation=rows("innovation"),
    )


@dataclass(frozen=True, eq=False)
class SmoothedWindow:
    """All states of one track's window, given all measurements so far; oldest first."""

    stamp_ns: NDArray[np.int64]
    """(K,)."""
    mean: F64
    """(K, 6) x, y, vx, vy, ax, ay."""
    covariance: F64 | None
    """(K, 6, 6), where asked for."""


class Belief(NamedTuple):
    """Newest state of several tracks."""

    mean: F64
    """(N, 6) in the caller's frame."""
    covariance: F64
    """(N, 6, 6)."""


class FixedLagEngine(ABC):
    """Windows of up to `lag_ns` for any number of tracks, addressed by slot.

    A slot is a small integer that the caller picks; it is free again after `release`. Positions are
    kept relative to each track's first one, so that map coordinates of 4e6 m cost no precision.
    """

    def __init__(self, noise: MotionNoise, lag_ns: int) -> None:
        if lag_ns < 0:
            raise InputError("lag_ns", lag_ns, "at least 0")
        self.noise = noise
        self.lag_ns = lag_ns
        self._windows: dict[int, deque[Node]] = {}
        self._last_stamp_ns: int | None = None
        self._stamp_ns = np.zeros(0, np.int64)
        self._anchor_m = np.zeros((0, 2))
        self._mean = np.zeros((0, STATE_DIM))
        self._covariance = np.zeros((0, STATE_DIM, STATE_DIM))

    def step(self, batch: NodeBatch) -> NDArray[np.bool_]:
        """Adds one node to every track of `batch`; returns (N,) which rows were taken.

        A row that cannot be used (not finite, no step in time, not positive definite) is left out
        and its track stays as it was; at a birth the slot stays free. Raises `InputError`, with
        nothing changed, when the stamp is not later than the last one, a birth's slot is in use or
        an update's slot is not.
        """
        if self._last_stamp_ns is not None and batch.stamp_ns <= self._last_stamp_ns:
            raise InputError("stamp_ns", batch.stamp_ns, f"later than {self._last_stamp_ns}")
        for slot, birth in zip(batch.slot.tolist(), batch.birth.tolist(), strict=True):
            if (slot in self._windows) == birth:
                state = "a free slot at a birth" if birth else "the slot of a live track"
                raise InputError("slot", slot, state)
        self._reserve(batch.slot)
        dt_s = self._since(batch.slot, batch.stamp_ns)
        dt_s[batch.birth] = 0.0
        taken = batch.usable(dt_s)
        self._last_stamp_ns = batch.stamp_ns
        if taken.any():
            taken[taken] = self._append(batch.select(taken), dt_s[taken])
        return taken

    def _append(self, batch: NodeBatch, dt_s: F64) -> NDArray[np.bool_]:
        born = batch.slot[batch.birth]
        self._anchor_m[born] = batch.position_m[batch.birth]
        advanced = self._advance(batch, dt_s)
        self._stamp_ns[batch.slot[advanced]] = batch.stamp_ns
        oldest_ns = batch.stamp_ns - self.lag_ns
        slots, steps, weights = batch.slot.tolist(), dt_s.tolist(), list(batch.weight)
        surprise = batch.innovation.max(axis=1, initial=0.0).tolist()
        for row in np.nonzero(advanced)[0].tolist():
            slot = slots[row]
            window = self._windows.setdefault(slot, deque())
            window.append(Node(batch, row, steps[row], weights[row], surprise[row]))
            while window[0].batch.stamp_ns < oldest_ns:
                self._drop_oldest(slot)
                window.popleft()
        return advanced

    def newest(self, slots: Slots) -> Belief:
        """State of each track at its own newest node, given all measurements so far."""
        mean = self._mean[slots].copy()
        mean[:, :2] += self._anchor_m[slots]
        return Belief(mean, self._covariance[slots])

    def predicted(self, slots: Slots, stamp_ns: int) -> Belief:
        """State of each track carried to `stamp_ns`, which is not before its newest node."""
        newest, dt_s = self.newest(slots), self._since(slots, stamp_ns)
        return Belief(*predict(newest.mean, newest.covariance, dt_s, self.noise))

    def window(self, slot: int) -> tuple[Node, ...]:
        """Nodes of one track's window, oldest first."""
        return tuple(self._windows[slot])

    def release(self, slot: int) -> None:
        """Forgets a track and frees its slot."""
        del self._windows[slot]
        self._forget(slot)

    def smooth(self, slot: int, covariance: bool = False) -> SmoothedWindow:
        """The whole window of one track; with covariances where asked for."""
        stamps = np.array([node.batch.stamp_ns for node in self._windows[slot]], np.int64)
        mean, spread = self._smooth(slot, covariance)
        mean[:, :2] += self._anchor_m[slot]
        return SmoothedWindow(stamps, mean, spread)

    def reweigh(self, slots: list[int], weights: list[F64]) -> None:
        """Eliminates whole windows anew with other weights of their measurements.

        `weights[i]` (K, 2) in (0, 1] goes with the K nodes of `slots[i]`. The weights of the oldest
        node are not read unless it is a birth: its measurements are part of the window's prior.
        """
        for slot, weight in zip(slots, weights, strict=True):
            window = self._windows[slot]
            if weight.shape != (len(window), 2):
                raise InputError("weights", weight.shape, str((len(window), 2)))
            if not ((weight > 0.0) & (weight <= 1.0)).all():
                raise InputError("weights", weight.tolist(), "numbers in (0, 1]")
            for k in range(0 if window[0].is_birth else 1, len(window)):
                window[k] = window[k]._replace(weight=weight[k])
        self._resolve(slots)

    def _since(self, slots: Slots, stamp_ns: int) -> F64:
        """(N,) seconds from the newest node of each track to `stamp_ns`."""
        return np.asarray((stamp_ns - self._stamp_ns[slots]) * 1e-9, np.float64)

    def _reserve(self, slots: Slots) -> None:
        needed = int(slots.max(initial=-1)) + 1
        have = len(self._stamp_ns)
        if needed > have:
            extra = max(needed, 2 * have) - have
            self._stamp_ns = np.concatenate([self._stamp_ns, np.zeros(extra, np.int64)])
            self._anchor_m = np.concatenate([self._anchor_m, np.zeros((extra, 2))])
            self._mean = np.concatenate([self._mean, np.zeros((extra, STATE_DIM))])
            fresh = np.tile(np.eye(STATE_DIM), (extra, 1, 1))
            self._covariance = np.concatenate([self._covariance, fresh])

    @abstractmethod
    def _advance(self, batch: NodeBatch, dt_s: F64) -> NDArray[np.bool_]:
        """Eliminates one step of every row's chain; sets means and covariances of the new nodes.

        Returns (N,) the rows that could be eliminated; the chains of the others are unchanged.
        """

    @abstractmethod
    def _drop_oldest(self, slot: int) -> None:
        """Marginalises the oldest state of a window of at least two."""

    @abstractmethod
    def _forget(self, slot: int) -> None:
        """Frees what is kept for the track."""

    @abstractmethod
    def _smooth(self, slot: int, covariance: bool) -> tuple[F64, F64 | None]:
        """Mean (K, 6), relative to the anchor, and covariance (K, 6, 6) of a window."""

    @abstractmethod
    def _resolve(self, slots: list[int]) -> None:
        """Eliminates whole windows from their nodes, after a change of weights."""

"""Common part of the fixed-lag engines: slots, windows, anchors and checks.

A chain of linear Gaussian factors is eliminated from the oldest state to the newest. Each step
leaves the conditional `p(x_k | x_k+1, z_1..k)`, which later measurements do not change; so dropping
the oldest conditional of a window is exact marginalisation, and the newest state equals that of
the Kalman filter. The window adds what a filter cannot give: smoothed history, and new weights for
measurements that turned out to be outliers.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, Protocol, Self, TypeVar

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.errors import InputError
from mottrack.trackers.fixed_lag.config import MotionModelConfig
from mottrack.trackers.fixed_lag.motion import STATE_DIM, predict
from mottrack.trackers.fixed_lag.nodes import NodeBatch
from mottrack.trackers.fixed_lag.store import Layout, NodeStore


class Selectable(Protocol):
    """Anything with rows."""

    def select(self, rows: Any) -> Self:
        """Return the rows that a mask or an index picks."""
        ...


EngineNodes = TypeVar("EngineNodes", bound=Selectable)
"""Nodes in the form in which an engine eliminates them."""


@dataclass(frozen=True, eq=False)
class SmoothedWindow:
    """All states of one track's window, given all measurements so far; oldest first."""

    stamp_ns: I64
    """(K,)."""
    mean: F64
    """(K, 6) x, y, vx, vy, ax, ay."""
    covariance: F64 | None
    """(K, 6, 6), where asked for."""


class Estimate(NamedTuple):
    """Newest state of several tracks."""

    mean: F64
    """(N, 6) in the caller's frame."""
    covariance: F64
    """(N, 6, 6)."""


class Recent(NamedTuple):
    """The newest nodes of several tracks, right-aligned: the last column is the newest."""

    slots: I64
    """(N,)."""
    column: I64
    """(N, D) where the nodes are stored."""
    there: Mask
    """(N, D) false where a window has fewer nodes."""
    open: Mask
    """(N, D) nodes whose weights may change: not the oldest of a window that lost older ones."""

    def select(self, rows: I64 | Mask) -> Recent:
        """Return the rows that a mask or an index picks."""
        return Recent(self.slots[rows], self.column[rows], self.there[rows], self.open[rows])


class History(NamedTuple):
    """Measurements of recent nodes, (N, D, ...); finite placeholders where no node is `there`."""

    there: Mask
    age_s: F64
    """Before the newest node of the track."""
    position_m: F64
    """About the anchor of the track."""
    position_covariance_m2: F64
    velocity_mps: F64
    velocity_covariance_m2ps2: F64
    has_velocity: Mask
    extent_m: F64
    """Diagonal of the footprint; that of the newest node where there is none."""


class FixedLagEngine(ABC, Generic[EngineNodes]):
    """Windows of up to `lag_ns` for any number of tracks, addressed by slot.

    A slot is a small integer that the caller picks; it is free again after `release`. Positions are
    kept relative to each track's first one, so that map coordinates of 4e6 m cost no precision.
    """

    def __init__(self, model: MotionModelConfig, lag_ns: int, layout: Layout) -> None:
        """Take the fields that the engine stores per node, besides its measurement, in `layout`."""
        if lag_ns < 0:
            raise InputError("lag_ns", lag_ns, "at least 0")
        self.model = model
        self.lag_ns = lag_ns
        self.store = NodeStore(layout)
        """The windows; engines write to them."""
        self._last_stamp_ns: int | None = None
        self._stamp_ns = np.zeros(0, np.int64)
        self._anchor_m = np.zeros((0, 2))
        self._mean = np.zeros((0, STATE_DIM))
        self._covariance = np.zeros((0, STATE_DIM, STATE_DIM))

    def step(self, batch: NodeBatch) -> Mask:
        """Add one node to every track of `batch` and return which rows (N,) were used.

        A row that cannot be used (not finite, no step in time, not positive definite) is left out
        and its track stays as it was; at a birth the slot stays free.

        Raises:
            InputError: the stamp is not later than the last one, a birth's slot is in use or an
                update's slot is not; nothing is changed then.
        """
        if self._last_stamp_ns is not None and batch.stamp_ns <= self._last_stamp_ns:
            raise InputError("stamp_ns", batch.stamp_ns, f"later than {self._last_stamp_ns}")
        conflict = self.store.live(batch.slot) == batch.birth
        if conflict.any():
            first = int(np.argmax(conflict))
            state = "a free slot at a birth" if batch.birth[first] else "the slot of a live track"
            raise InputError("slot", int(batch.slot[first]), state)
        self._reserve(batch.slot)
        dt_s = self._since(batch.slot, batch.stamp_ns)
        dt_s[batch.birth] = 0.0
        taken = batch.usable(dt_s)
        self._last_stamp_ns = batch.stamp_ns
        if taken.any():
            taken[taken] = self._append(batch.select(taken), dt_s[taken])
        return taken

    def _append(self, batch: NodeBatch, dt_s: F64) -> Mask:
        born = batch.slot[batch.birth]
        self._anchor_m[born] = batch.position_m[batch.birth]
        column = self.store.at(batch.slot, self.store.count[batch.slot])
        prepared = self._prepare(batch, self._anchor_m[batch.slot], dt_s)
        advanced = self._advance(prepared, batch.slot, column)
        grown = batch.select(advanced)
        self._stamp_ns[grown.slot] = batch.stamp_ns
        self.store.append(grown, dt_s[advanced])
        self.store.drop_before(grown.slot, batch.stamp_ns - self.lag_ns)
        return advanced

    def newest(self, slots: I64) -> Estimate:
        """Return the state of each track at its own newest node, given all measurements so far."""
        mean = self._mean[slots].copy()
        mean[:, :2] += self._anchor_m[slots]
        return Estimate(mean, self._covariance[slots])

    def predicted(self, slots: I64, stamp_ns: int) -> Estimate:
        """Return the state of each track at `stamp_ns`, which is not before its newest node."""
        newest, dt_s = self.newest(slots), self._since(slots, stamp_ns)
        return Estimate(*predict(newest.mean, newest.covariance, dt_s, self.model))

    def release(self, slot: int) -> None:
        """Delete a track and free its slot."""
        self.store.clear(slot)

    def live(self) -> I64:
        """Return the slots (N,) of all tracks, ascending."""
        return np.flatnonzero(self.store.count)

    def smooth(self, slot: int, covariance: bool = False) -> SmoothedWindow:
        """Return the whole window of one track, with covariances if `covariance` is set."""
        window = self.recent(np.array([slot]), int(self.store.count[slot]))
        stamps = self.store["stamp_ns"][slot, window.column[0]]
        mean = self.smoothed(window)[0]
        mean[:, :2] += self._anchor_m[slot]
        spread = self._smoothed_covariance(slot, window.column[0]) if covariance else None
        return SmoothedWindow(stamps, mean, spread)

    def recent(self, slots: I64, depth: int) -> Recent:
        """Return the newest `depth` nodes of live tracks (N,)."""
        count = self.store.count[slots][:, None]
        number = count - depth + np.arange(depth)
        column = self.store.at(slots[:, None], np.maximum(number, 0))
        there = number >= 0
        birth = self.store["birth"][slots[:, None], column]
        return Recent(slots, column, there, there & (birth | (number > 0)))

    def innovation(self, recent: Recent) -> F64:
        """Return the normalised innovations (N, D, 2) of position and velocity; 0 without node."""
        found = self.store["innovation"][recent.slots[:, None], recent.column]
        return np.where(recent.there[:, :, None], found, 0.0)

    def weight(self, recent: Recent) -> F64:
        """Return the robust weights (N, D, 2) of position and velocity."""
        return self.store["weight"][recent.slots[:, None], recent.column]

    def history(self, recent: Recent) -> History:
        """Return what was measured at these nodes."""
        slots = recent.slots[:, None]
        found = self.store.fields(slots, recent.column)
        stamp_ns = self.store["stamp_ns"][slots, recent.column]
        has = found["has_velocity"] & recent.there
        there, seen = recent.there[:, :, None, None], has[:, :, None, None]
        return History(
            there=recent.there,
            age_s=np.where(recent.there, (stamp_ns[:, -1:] - stamp_ns) * 1e-9, 0.0),
            position_m=found["position_m"] - self._anchor_m[slots],
            position_covariance_m2=np.where(there, found["position_covariance_m2"], np.eye(2)),
            velocity_mps=np.where(seen[..., 0], found["velocity_mps"], 0.0),
            velocity_covariance_m2ps2=np.where(seen, found["velocity_covariance_m2ps2"], np.eye(2)),
            has_velocity=has,
            extent_m=np.where(recent.there, found["extent_m"], found["extent_m"][:, -1:]),
        )

    def reweigh(self, recent: Recent, weight: F64, first: I64) -> None:
        """Set weights (N, D, 2) of nodes, from column `first` (N,) on, and eliminate these again.

        Nodes before a track's first new weight are not affected.
        """
        before = self.store.rows(recent.slots)
        newest = self._mean[recent.slots], self._covariance[recent.slots]
        sound = np.ones(len(recent.slots), np.bool_)
        anew = np.arange(weight.shape[1]) >= first[:, None]
        slots = np.repeat(recent.slots, anew.sum(axis=1))
        self.store["weight"][slots, recent.column[anew]] = weight[anew]
        fields = self.store.fields(slots, recent.column[anew])
        dt_s = self.store["dt_s"][slots, recent.column[anew]]
        nodes = NodeBatch(stamp_ns=0, slot=np.arange(len(slots)), **fields)
        prepared = self._prepare(nodes, self._anchor_m[slots], dt_s)
        place = np.cumsum(anew).reshape(anew.shape) - 1
        for depth in range(int(first.min(initial=weight.shape[1])), weight.shape[1]):
            rows = np.flatnonzero(sound & anew[:, depth])
            some = prepared.select(place[rows, depth])
            sound[rows] = self._advance(some, recent.slots[rows], recent.column[rows, depth])
        failed = recent.slots[~sound]
        self.store.restore(failed, {name: rows[~sound] for name, rows in before.items()})
        self._mean[failed], self._covariance[failed] = newest[0][~sound], newest[1][~sound]

    def _since(self, slots: I64, stamp_ns: int) -> F64:
        """Return the seconds (N,) from the newest node of each track to `stamp_ns`."""
        return np.asarray((stamp_ns - self._stamp_ns[slots]) * 1e-9, np.float64)

    def _reserve(self, slots: I64) -> None:
        self.store.reserve(slots)
        extra = len(self.store.count) - len(self._stamp_ns)
        if extra:
            self._stamp_ns = np.append(self._stamp_ns, np.zeros(extra, np.int64))
            self._anchor_m = np.concatenate([self._anchor_m, np.zeros((extra, 2))])
            self._mean = np.concatenate([self._mean, np.zeros((extra, STATE_DIM))])
            fresh = np.tile(np.eye(STATE_DIM), (extra, 1, 1))
            self._covariance = np.concatenate([self._covariance, fresh])

    @abstractmethod
    def _prepare(self, batch: NodeBatch, anchor_m: F64, dt_s: F64) -> EngineNodes:
        """Return what `_advance` needs of nodes (N,), which may belong to one track or to many."""

    @abstractmethod
    def _advance(self, nodes: EngineNodes, slots: I64, column: I64) -> Mask:
        """Eliminate one step of the chain of each slot (N,), up to the node in `column` (N,).

        Sets means and covariances of the new nodes. Returns which rows (N,) could be eliminated;
        the chains of the others are unchanged.
        """

    @abstractmethod
    def smoothed(self, recent: Recent) -> F64:
        """Return means (N, D, 6) about the anchors, given all data; undefined without node."""

    @abstractmethod
    def _smoothed_covariance(self, slot: int, column: I64) -> F64:
        """Return the covariances (K, 6, 6) of a whole window, stored in these columns (K,)."""


Engine = FixedLagEngine[Any]
"""Any of the engines."""

"""What one frame adds to the factor graph: a state node per associated track, and its factors."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.errors import InputError
from mottrack.trackers.fixed_lag.motion import (
    MotionNoise,
    planar_root_information,
    process_noise,
    square_root_information,
    transition,
)

MIN_STEP_S = 1e-3
"""Shorter steps make Q(dt) singular in double precision."""
MAX_STEP_S = 60.0

MEASUREMENT: dict[str, tuple[Any, tuple[int, ...]]] = {
    "birth": (np.bool_, ()),
    "position_m": (np.float64, (2,)),
    "position_covariance_m2": (np.float64, (2, 2)),
    "velocity_mps": (np.float64, (2,)),
    "velocity_covariance_m2ps2": (np.float64, (2, 2)),
    "has_velocity": (np.bool_, ()),
    "extent_m": (np.float64, ()),
    "weight": (np.float64, (2,)),
    "innovation": (np.float64, (2,)),
}
"""Type and shape of what is measured at a node."""


@dataclass(frozen=True, eq=False)
class NodeBatch:
    """The measurements of one stamp, one row a track. Positions and velocities in one fixed frame.

    Raises `InputError` when shapes disagree or a track appears twice: GTSAM ends the process on
    wrong shapes, so they never reach it. Values are judged row by row, by `usable`.
    """

    stamp_ns: int
    slot: I64
    """(N,) the track each row belongs to."""
    birth: Mask
    """(N,) the first node of its track."""
    position_m: F64
    """(N, 2)."""
    position_covariance_m2: F64
    """(N, 2, 2)."""
    velocity_mps: F64
    """(N, 2), read only where `has_velocity`."""
    velocity_covariance_m2ps2: F64
    """(N, 2, 2)."""
    has_velocity: Mask
    """(N,)."""
    extent_m: F64
    """(N,) diagonal of the object's footprint; where it changes, so may the position."""
    weight: F64
    """(N, 2) in (0, 1], the robust weights of the position and the velocity factor."""
    innovation: F64
    """(N, 2) normalised distance of position and velocity from the prediction; 0 at a birth."""

    def __post_init__(self) -> None:
        count = len(self.slot)
        if self.slot.shape != (count,):
            raise InputError("slot", self.slot.shape, str((count,)))
        for field, (_, tail) in MEASUREMENT.items():
            if getattr(self, field).shape != (count, *tail):
                raise InputError(field, getattr(self, field).shape, str((count, *tail)))
        if len(np.unique(self.slot)) != count:
            raise InputError("slot", self.slot.tolist(), "each track at most once")

    def __len__(self) -> int:
        return len(self.slot)

    def select(self, rows: NDArray[Any]) -> NodeBatch:
        """The rows that a mask or an index picks."""
        if rows.dtype == np.bool_ and rows.all():
            return self
        arrays = {name: getattr(self, name)[rows] for name in MEASUREMENT}
        return NodeBatch(stamp_ns=self.stamp_ns, slot=self.slot[rows], **arrays)

    def usable(self, dt_s: F64) -> Mask:
        """(N,) rows that can be eliminated: finite, positive definite, with a step in time.

        `dt_s` (N,) is ignored at births. The rows are judged apart, so that one bad track does not
        cost the others their frame.
        """
        position = np.isfinite(self.position_m).all(axis=1) & definite(self.position_covariance_m2)
        velocity = np.isfinite(self.velocity_mps).all(axis=1)
        velocity &= definite(self.velocity_covariance_m2ps2)
        step = self.birth | ((dt_s >= MIN_STEP_S) & (dt_s <= MAX_STEP_S))
        weight = ((self.weight > 0.0) & (self.weight <= 1.0)).all(axis=1)
        usable: Mask = position & (velocity | ~self.has_velocity) & step & weight
        return usable


def definite(covariance: F64) -> Mask:
    """(N,) 2 x 2 matrices that are finite, symmetric, positive definite and of sane magnitude."""
    xx, yy, xy = covariance[:, 0, 0], covariance[:, 1, 1], covariance[:, 0, 1]
    with np.errstate(all="ignore"):
        sane = (xx > 1e-12) & (yy > 1e-12) & (xx < 1e12) & (yy < 1e12)
        symmetric = np.abs(xy - covariance[:, 1, 0]) <= 1e-9 * np.sqrt(np.abs(xx * yy))
        return sane & symmetric & (xx * yy - xy**2 > 1e-12 * xx * yy)


@dataclass(frozen=True, eq=False)
class WhitenedRows:
    """Every factor of a frame in unit noise, stacked: motion 6, position 2, velocity 2 rows.

    `previous @ x_0 + current @ x_1 = target`. At a birth the first four rows are the prior of
    velocity and acceleration and rows 4 and 5 are empty. Rows 8 and 9 are the velocity factor and
    are left out by `count` where there is none.
    """

    previous: F64
    """(N, 10, 6)."""
    current: F64
    """(N, 10, 6)."""
    target: F64
    """(N, 10)."""
    count: I64
    """(N,) rows in use: 10, or 8 without velocity."""
    birth: Mask
    """(N,) the first node of its track."""

    def select(self, rows: NDArray[Any]) -> WhitenedRows:
        """The nodes that a mask or an index picks."""
        return WhitenedRows(*(getattr(self, field.name)[rows] for field in fields(self)))


def whiten(batch: NodeBatch, anchor_m: F64, dt_s: F64, noise: MotionNoise) -> WhitenedRows:
    """Whiten the factors of `batch`; positions are taken relative to `anchor_m` (N, 2)."""
    count = len(batch)
    previous, current = np.zeros((count, 10, 6)), np.zeros((count, 10, 6))
    target = np.zeros((count, 10))
    # most tracks were last seen in the same frame: few steps are different
    step_s, which = np.unique(np.where(batch.birth, 0.1, dt_s), return_inverse=True)
    root = square_root_information(process_noise(step_s, noise))
    previous[:, :6] = (-root @ transition(step_s))[which]
    current[:, :6] = root[which]
    previous[batch.birth] = 0.0
    current[batch.birth, :6] = birth_prior(noise)
    root = planar_root_information(batch.position_covariance_m2)
    root *= np.sqrt(batch.weight[:, 0])[:, None, None]
    current[:, 6:8, 0:2] = root
    target[:, 6:8] = (root @ (batch.position_m - anchor_m)[:, :, None])[:, :, 0]
    seen = batch.has_velocity
    root = planar_root_information(batch.velocity_covariance_m2ps2[seen])
    root *= np.sqrt(batch.weight[seen, 1])[:, None, None]
    current[seen, 8:10, 2:4] = root
    target[seen, 8:10] = (root @ batch.velocity_mps[seen][:, :, None])[:, :, 0]
    return WhitenedRows(previous, current, target, np.where(seen, 10, 8), batch.birth)


def birth_prior(noise: MotionNoise) -> F64:
    """(6, 6) prior rows of a new track: velocity and acceleration about zero, two empty rows.

    Without them one position leaves velocity and acceleration undetermined.
    """
    rows = np.zeros((6, 6))
    rows[range(2), range(2, 4)] = 1.0 / noise.birth_speed_sigma_mps
    rows[range(2, 4), range(4, 6)] = 1.0 / noise.birth_acceleration_sigma_mps2
    return rows

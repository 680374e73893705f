"""Measurements of one frame, and the nodes and factors that they add to the graph."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.errors import InputError
from mottrack.core.objects import Objects
from mottrack.geometry.two_by_two import is_covariance_2x2, root_information_2x2
from mottrack.trackers.fixed_lag.config import MeasurementConfig, MotionModelConfig
from mottrack.trackers.fixed_lag.motion import process_noise, transition

MIN_STEP_S = 1e-3
"""Shorter steps make Q(dt) singular in double precision."""
MAX_STEP_S = 60.0
"""Over longer steps the prediction says nothing, and Q(dt) grows with dt^5 beyond any use."""

NODE_FIELDS: dict[str, tuple[Any, tuple[int, ...]]] = {
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
"""Type and shape of each field of a node."""


@dataclass(frozen=True, eq=False)
class NodeBatch:
    """The measurements of one stamp, one row a track. Positions and velocities in one fixed frame.

    GTSAM ends the process on wrong shapes, so they are refused here; values are checked row by row,
    by `usable`.

    Raises:
        InputError: shapes disagree, or a track appears twice.
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
        for field, (_, tail) in NODE_FIELDS.items():
            if getattr(self, field).shape != (count, *tail):
                raise InputError(field, getattr(self, field).shape, str((count, *tail)))
        if len(np.unique(self.slot)) != count:
            raise InputError("slot", self.slot.tolist(), "each track at most once")

    def __len__(self) -> int:
        return len(self.slot)

    def select(self, rows: NDArray[Any]) -> NodeBatch:
        """Return the rows that a mask or an index picks."""
        if rows.dtype == np.bool_ and rows.all():
            return self
        arrays = {name: getattr(self, name)[rows] for name in NODE_FIELDS}
        return NodeBatch(stamp_ns=self.stamp_ns, slot=self.slot[rows], **arrays)

    def usable(self, dt_s: F64) -> Mask:
        """Return which rows (N,) can be eliminated: finite, positive definite, with a step in time.

        `dt_s` (N,) is ignored at births. Each row is checked by itself, so that one bad track does
        not affect the others.
        """
        position = np.isfinite(self.position_m).all(axis=1)
        position &= is_covariance_2x2(self.position_covariance_m2)
        velocity = np.isfinite(self.velocity_mps).all(axis=1)
        velocity &= is_covariance_2x2(self.velocity_covariance_m2ps2)
        step = self.birth | ((dt_s >= MIN_STEP_S) & (dt_s <= MAX_STEP_S))
        weight = ((self.weight > 0.0) & (self.weight <= 1.0)).all(axis=1)
        return position & (velocity | ~self.has_velocity) & step & weight


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
        """Return the nodes that a mask or an index picks."""
        return WhitenedRows(*(getattr(self, field.name)[rows] for field in fields(self)))


def whiten(batch: NodeBatch, anchor_m: F64, dt_s: F64, model: MotionModelConfig) -> WhitenedRows:
    """Whiten the factors of `batch`; positions are taken relative to `anchor_m` (N, 2)."""
    count = len(batch)
    previous, current = np.zeros((count, 10, 6)), np.zeros((count, 10, 6))
    target = np.zeros((count, 10))
    # most tracks were last seen in the same frame: few steps differ. Births ignore theirs (0.1 s)
    step_s, which = np.unique(np.where(batch.birth, 0.1, dt_s), return_inverse=True)
    root = np.linalg.inv(np.linalg.cholesky(process_noise(step_s, model)))
    previous[:, :6] = (-root @ transition(step_s))[which]
    current[:, :6] = root[which]
    previous[batch.birth] = 0.0
    current[batch.birth, :6] = _birth_prior(model)
    root = root_information_2x2(batch.position_covariance_m2)
    root *= np.sqrt(batch.weight[:, 0])[:, None, None]
    current[:, 6:8, 0:2] = root
    target[:, 6:8] = (root @ (batch.position_m - anchor_m)[:, :, None])[:, :, 0]
    seen = batch.has_velocity
    root = root_information_2x2(batch.velocity_covariance_m2ps2[seen])
    root *= np.sqrt(batch.weight[seen, 1])[:, None, None]
    current[seen, 8:10, 2:4] = root
    target[seen, 8:10] = (root @ batch.velocity_mps[seen][:, :, None])[:, :, 0]
    return WhitenedRows(previous, current, target, np.where(seen, 10, 8), batch.birth)


def _birth_prior(model: MotionModelConfig) -> F64:
    """Return (6, 6) prior rows of a new track: velocity and acceleration about 0, two empty rows.

    Without them one position leaves velocity and acceleration undetermined.
    """
    rows = np.zeros((6, 6))
    rows[range(2), range(2, 4)] = 1.0 / model.birth_speed_sigma_mps
    rows[range(2, 4), range(4, 6)] = 1.0 / model.birth_acceleration_sigma_mps2
    return rows


@dataclass(frozen=True, eq=False)
class Measurements:
    """Positions' noise and velocities of M objects."""

    position_covariance_m2: F64
    """(M, 2, 2)."""
    velocity_mps: F64
    """(M, 2)."""
    velocity_covariance_m2ps2: F64
    """(M, 2, 2)."""
    has_velocity: Mask
    """(M,)."""
    usable: Mask
    """(M,) objects whose position can be a measurement."""

    def with_velocity(self, rows: I64, mean: F64, covariance: F64) -> Measurements:
        """Return the same with the velocities of some rows (n,) replaced."""
        velocity, spread = self.velocity_mps.copy(), self.velocity_covariance_m2ps2.copy()
        has = self.has_velocity.copy()
        velocity[rows], spread[rows], has[rows] = mean, covariance, True
        return Measurements(self.position_covariance_m2, velocity, spread, has, self.usable)

    def widened(self, factor: F64) -> Measurements:
        """Return the same with the covariances of velocities multiplied by a factor (M,)."""
        spread = factor[:, None, None] * self.velocity_covariance_m2ps2
        return replace(self, velocity_covariance_m2ps2=spread)


def measurements_of(objects: Objects, config: MeasurementConfig) -> Measurements:
    """Return the measurements of M objects; noise that an object lacks comes from the settings."""
    count = len(objects)
    position = objects.position_covariance_m2
    if position is None:
        position = np.tile(config.position_sigma_m**2 * np.eye(2), (count, 1, 1))
    velocity, spread = np.zeros((count, 2)), np.tile(np.eye(2), (count, 1, 1))
    has = np.zeros(count, np.bool_)
    if objects.velocity is not None and config.use_velocity:
        floor = config.velocity_floor_mps**2 * np.eye(2)
        has = objects.velocity.valid.copy()
        velocity[has] = objects.velocity.mean_mps[has]
        spread[has] = objects.velocity.covariance_m2ps2[has] + floor
        has &= is_covariance_2x2(spread)
    return Measurements(position, velocity, spread, has, is_covariance_2x2(position))

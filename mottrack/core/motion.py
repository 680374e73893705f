"""Measured motion: of every cell of the grid, and of every object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.checks import as_array, as_stamp, require_covariance, require_finite
from mottrack.core.errors import InputError
from mottrack.core.grid import BevGrid
from mottrack.core.pose import rotation_2d


@dataclass(frozen=True, slots=True)
class FlowField:
    """Velocity of every cell over the ground, in the axes of the CURRENT ego frame.

    Ego motion is removed: a wall has velocity zero. It is a velocity, never a displacement per
    frame: the elapsed time is divided out once, inside the source.

    Raises:
        InputError: a shape is not the grid's, or a number is not finite.
    """

    grid: BevGrid
    velocity_mps: NDArray[np.float32]
    """(H, W, 2) velocity along x and y."""
    covariance_m2ps2: NDArray[np.float32]
    """(H, W, 2, 2) covariance of the velocity's error."""
    occupied: NDArray[np.bool_]
    """(H, W) whether the current sweep has a non-ground point in the cell."""
    valid: NDArray[np.bool_]
    """(H, W) whether the source measured the velocity of the cell."""
    weight: NDArray[np.float32]
    """(H, W) occupancy probability in [0, 1]."""
    stamp_ns: int
    """Stamp of the current sweep."""

    def __post_init__(self) -> None:
        shape = self.grid.shape
        for name, dtype, full in (
            ("velocity_mps", np.float32, (*shape, 2)),
            ("covariance_m2ps2", np.float32, (*shape, 2, 2)),
            ("occupied", np.bool_, shape),
            ("valid", np.bool_, shape),
            ("weight", np.float32, shape),
        ):
            array = as_array(name, getattr(self, name), dtype, full)
            if dtype is np.float32:
                require_finite(name, array)
            object.__setattr__(self, name, array)
        object.__setattr__(self, "stamp_ns", as_stamp("stamp_ns", self.stamp_ns))

    @classmethod
    def empty(cls, grid: BevGrid, stamp_ns: int) -> FlowField:
        """A field in which nothing is occupied and nothing was measured."""
        return cls.unmeasured(grid, np.zeros(grid.shape, dtype=np.bool_), stamp_ns)

    @classmethod
    def unmeasured(cls, grid: BevGrid, occupied: NDArray[np.bool_], stamp_ns: int) -> FlowField:
        """A field with (H, W) ``occupied`` cells of which no velocity was measured."""
        shape = grid.shape
        return cls(
            grid=grid,
            velocity_mps=np.zeros((*shape, 2), dtype=np.float32),
            covariance_m2ps2=np.zeros((*shape, 2, 2), dtype=np.float32),
            occupied=occupied,
            valid=np.zeros(shape, dtype=np.bool_),
            weight=occupied.astype(np.float32),
            stamp_ns=stamp_ns,
        )


@dataclass(frozen=True, slots=True)
class VelocityMeasurement:
    """A measured velocity for each of N objects, or none: by mask, never by zero.

    Raises:
        InputError: a shape is wrong; a valid row is not finite or its covariance not positive
            semi-definite.
    """

    mean_mps: NDArray[np.float64]
    """(N, 2) velocity along x and y, in the axes of the objects' frame; 0 where invalid."""
    covariance_m2ps2: NDArray[np.float64]
    """(N, 2, 2) covariance of its error."""
    valid: NDArray[np.bool_]
    """(N,) whether the object has a measured velocity."""

    def __post_init__(self) -> None:
        valid = as_array("valid", self.valid, np.bool_, (None,))
        n = len(valid)
        mean = as_array("mean_mps", self.mean_mps, np.float64, (n, 2))
        covariance = as_array("covariance_m2ps2", self.covariance_m2ps2, np.float64, (n, 2, 2))
        mean = np.where(valid[:, None], mean, 0.0)
        covariance = np.where(valid[:, None, None], covariance, 0.0)
        require_finite("mean_mps", mean)
        require_covariance("covariance_m2ps2", covariance)
        object.__setattr__(self, "mean_mps", mean)
        object.__setattr__(self, "covariance_m2ps2", covariance)
        object.__setattr__(self, "valid", valid)

    def __len__(self) -> int:
        return len(self.valid)

    @classmethod
    def absent(cls, n: int) -> VelocityMeasurement:
        """No velocity for any of ``n`` objects."""
        return cls(np.zeros((n, 2)), np.zeros((n, 2, 2)), np.zeros(n, dtype=np.bool_))

    def select(self, index: NDArray[Any]) -> VelocityMeasurement:
        """The rows that a boolean mask or an integer index picks."""
        return VelocityMeasurement(
            self.mean_mps[index], self.covariance_m2ps2[index], self.valid[index]
        )

    def rotated(self, yaw_rad: float) -> VelocityMeasurement:
        """The same velocities in axes turned by ``-yaw_rad``: v' = R v, C' = R C R^T."""
        r = rotation_2d(yaw_rad)
        return VelocityMeasurement(self.mean_mps @ r.T, r @ self.covariance_m2ps2 @ r.T, self.valid)


def concatenate_velocities(parts: list[VelocityMeasurement]) -> VelocityMeasurement:
    """Stacks measurements of several groups of objects in order.

    Raises:
        InputError: ``parts`` is empty.
    """
    if not parts:
        raise InputError("parts", "[]", "at least one VelocityMeasurement")
    return VelocityMeasurement(
        np.concatenate([p.mean_mps for p in parts]),
        np.concatenate([p.covariance_m2ps2 for p in parts]),
        np.concatenate([p.valid for p in parts]),
    )

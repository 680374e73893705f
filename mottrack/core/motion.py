"""Measured velocities: of every cell of the grid, and of every object."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F32, F64, Mask
from mottrack.core.checks import (
    as_array,
    require_all,
    require_covariance,
    require_finite,
    require_within,
    set_array,
    set_stamp,
)
from mottrack.core.errors import InputError
from mottrack.core.flow_colour import bold_flow_to_rgb
from mottrack.core.grid import BevGrid
from mottrack.core.pictures import captioned, image
from mottrack.core.pose import rotation_2d
from mottrack.core.velocity_errors import NO_OUTLIERS, VelocityErrorModel

UNSEEN_M2PS2 = 1e6
"""Variance across the measured axis: (1 km/s)^2 carries no information."""
MAX_SPEED_MPS, MAX_COVARIANCE_M2PS2 = 1e6, 1e13
"""Beyond every vehicle and satellite, and above `UNSEEN_M2PS2` of any share: a damaged number."""
WEIGHT_ROUNDING = 1e-4
"""Sums in float32 may exceed [0, 1] by this much."""
UNIT_ROUNDING = 1e-6
"""Error of the length of a unit vector that was computed in float32."""
FULL_COLOUR_MPS = 15.0
"""Speed with the full colour in pictures: that of town traffic."""
STILL_MPS = 0.3
"""A slower cell is drawn in grey, at rest; chosen by eye."""
RESTING = (75, 85, 99)
"""Its colour."""
PINV_CUTOFF = 1e-14
"""Eigenvalues of A + B below this share of the largest are zero: above the rounding of float64
(2e-16), below 1e-12, the share of a radial variance of 1e-6 (m/s)^2 beside `UNSEEN_M2PS2`."""

MOVING_MPS = 0.5
"""A faster object, cell or point moves: annotated tracks of parked cars move by up to 0.3 m/s."""


@dataclass(frozen=True, slots=True)
class FlowField:
    """Velocity of every cell over the ground, in the axes of the CURRENT ego frame.

    Ego motion is removed: a wall has velocity zero. It is a velocity, never a displacement per
    frame: the source divides by the elapsed time.

    Raises:
        InputError: a shape is not the grid's, a number is not finite, a weight outside [0, 1].
    """

    grid: BevGrid
    velocity_mps: F32
    """(H, W, 2) velocity along x and y."""
    covariance_m2ps2: F32
    """(H, W, 2, 2) covariance of the velocity's error."""
    occupied: Mask
    """(H, W) whether the current sweep has a non-ground point in the cell."""
    valid: Mask
    """(H, W) whether the source measured the velocity of the cell."""
    weight: F32
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
            array = set_array(self, name, dtype, full)
            if dtype is np.float32:
                require_finite(name, array)
        if not (self.weight.min() >= -WEIGHT_ROUNDING and self.weight.max() <= 1 + WEIGHT_ROUNDING):
            span = [float(self.weight.min()), float(self.weight.max())]
            raise InputError("range of weight", span, "within [0, 1]")
        set_stamp(self)

    def __repr__(self) -> str:
        rows, columns = self.grid.shape
        speeds = np.hypot(self.velocity_mps[..., 0], self.velocity_mps[..., 1])[self.valid]
        fastest = f", up to {speeds.max():.1f} m/s" if len(speeds) else ""
        return (
            f"FlowField({rows} x {columns} cells, {np.count_nonzero(self.occupied)} occupied, "
            f"{len(speeds)} measured{fastest})"
        )

    def _repr_html_(self) -> str:
        """Return a picture for notebooks: the vehicle drives to the right, hue is direction."""
        rgb = np.full((*self.grid.shape, 3), 255, np.uint8)
        rgb[self.occupied] = RESTING
        moving = self.valid & (np.hypot(*np.moveaxis(self.velocity_mps, -1, 0)) > STILL_MPS)
        colours = bold_flow_to_rgb(self.velocity_mps[moving], FULL_COLOUR_MPS)
        rgb[moving] = np.rint(255 * colours).astype(np.uint8)
        text = f"{self!r}; hue is direction, full colour {FULL_COLOUR_MPS:.0f} m/s"
        return captioned(text, image(rgb[::-1]))  # row 0 of the grid lies at the right edge

    @classmethod
    def empty(cls, grid: BevGrid, stamp_ns: int) -> FlowField:
        """Return a field in which nothing is occupied and nothing was measured."""
        return cls.unmeasured(grid, np.zeros(grid.shape, dtype=np.bool_), stamp_ns)

    @classmethod
    def unmeasured(cls, grid: BevGrid, occupied: Mask, stamp_ns: int) -> FlowField:
        """Return a field with (H, W) ``occupied`` cells of which no velocity was measured."""
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
    """A measured velocity for each of N objects; what was not measured is masked, never zero.

    Raises:
        InputError: a shape is wrong; a valid row is not finite or its covariance not positive
            semi-definite.
    """

    mean_mps: F64
    """(N, 2) velocity along x and y, in the axes of the objects' frame; 0 where invalid."""
    covariance_m2ps2: F64
    """(N, 2, 2) covariance of its error."""
    valid: Mask
    """(N,) whether the object has a measured velocity."""
    error_model: VelocityErrorModel = NO_OUTLIERS
    """Errors of the source that the covariance does not describe."""

    def __post_init__(self) -> None:
        valid = set_array(self, "valid", np.bool_, (None,))
        n = len(valid)
        mean = as_array("mean_mps", self.mean_mps, np.float64, (n, 2))
        covariance = as_array("covariance_m2ps2", self.covariance_m2ps2, np.float64, (n, 2, 2))
        mean = np.where(valid[:, None], mean, 0.0)
        covariance = np.where(valid[:, None, None], covariance, 0.0)
        require_within("mean_mps", mean, MAX_SPEED_MPS, "m/s")
        require_within("covariance_m2ps2", covariance, MAX_COVARIANCE_M2PS2, "m^2/s^2")
        require_covariance("covariance_m2ps2", covariance)
        object.__setattr__(self, "mean_mps", mean)
        object.__setattr__(self, "covariance_m2ps2", covariance)

    def __len__(self) -> int:
        return len(self.valid)

    @classmethod
    def absent(cls, n: int) -> VelocityMeasurement:
        """Return no velocity for any of ``n`` objects."""
        return cls(np.zeros((n, 2)), np.zeros((n, 2, 2)), np.zeros(n, dtype=np.bool_))

    @classmethod
    def along(cls, direction: F64, speed_mps: F64, variance_m2ps2: F64) -> VelocityMeasurement:
        """Make velocities from speeds along one axis each, as by radar Doppler.

        Args:
            direction: (N, 2) unit vectors of the beams, in the axes of the objects' frame.
            speed_mps: (N,) speed over the ground along them (ego motion removed).
            variance_m2ps2: (N,) variance of the speed's error.

        Raises:
            InputError: a direction is not of length one, or a variance is negative.
        """
        beam = as_array("direction", direction, np.float64, (None, 2))
        norm = np.linalg.norm(beam, axis=1)
        require_all("length of direction", norm, np.abs(norm - 1.0) < UNIT_ROUNDING, "1")
        speed = as_array("speed_mps", speed_mps, np.float64, (len(beam),))
        variance = as_array("variance_m2ps2", variance_m2ps2, np.float64, (len(beam),))
        require_all("variance_m2ps2", variance, variance >= 0, "a variance of at least 0")
        across = np.stack([-beam[:, 1], beam[:, 0]], axis=1)
        covariance = variance[:, None, None] * beam[:, :, None] * beam[:, None, :]
        covariance += UNSEEN_M2PS2 * across[:, :, None] * across[:, None, :]
        return cls(speed[:, None] * beam, covariance, np.ones(len(beam), dtype=np.bool_))

    def select(self, index: NDArray[Any]) -> VelocityMeasurement:
        """Return the rows that a boolean mask or an integer index picks."""
        return VelocityMeasurement(
            self.mean_mps[index], self.covariance_m2ps2[index], self.valid[index], self.error_model
        )

    def with_error_model(self, error_model: VelocityErrorModel) -> VelocityMeasurement:
        """Return the same velocities with another error model of the source."""
        return replace(self, error_model=error_model)

    def rotated(self, yaw_rad: float) -> VelocityMeasurement:
        """Return the same velocities in axes rotated by ``-yaw_rad``: v' = R v, C' = R C R^T."""
        r = rotation_2d(yaw_rad)
        return VelocityMeasurement(
            self.mean_mps @ r.T, r @ self.covariance_m2ps2 @ r.T, self.valid, self.error_model
        )


def fuse_velocities(parts: list[VelocityMeasurement]) -> VelocityMeasurement:
    """Fuse independent measurements of the same objects, each where it is valid.

    C = A (A + B)^-1 B and v = B (A + B)^-1 a + A (A + B)^-1 b: unlike the information form it also
    holds for exact (A = 0) and for one-axis measurements. The fused error model takes the smaller
    of each number: independent sources confirm each other.

    Raises:
        InputError: ``parts`` is empty, or the parts are of different lengths.
    """
    if not parts:
        raise InputError("parts", "[]", "at least one VelocityMeasurement")
    fused = parts[0]
    for part in parts[1:]:
        if len(part) != len(fused):
            raise InputError("length of a part", len(part), str(len(fused)))
        fused = _fuse_two(fused, part)
    return fused


def _fuse_two(a: VelocityMeasurement, b: VelocityMeasurement) -> VelocityMeasurement:
    both = a.valid & b.valid
    inverse = np.linalg.pinv(
        a.covariance_m2ps2 + b.covariance_m2ps2, rcond=PINV_CUTOFF, hermitian=True
    )
    weight_a, weight_b = b.covariance_m2ps2 @ inverse, a.covariance_m2ps2 @ inverse
    mean = (weight_a @ a.mean_mps[:, :, None] + weight_b @ b.mean_mps[:, :, None])[:, :, 0]
    covariance = weight_b @ b.covariance_m2ps2
    single_mean = np.where(a.valid[:, None], a.mean_mps, b.mean_mps)
    single = np.where(a.valid[:, None, None], a.covariance_m2ps2, b.covariance_m2ps2)
    return VelocityMeasurement(
        np.where(both[:, None], mean, single_mean),
        np.where(both[:, None, None], 0.5 * (covariance + covariance.swapaxes(1, 2)), single),
        a.valid | b.valid,
        _error_model(min, [a, b]),
    )


def concatenate_velocities(parts: list[VelocityMeasurement]) -> VelocityMeasurement:
    """Stack measurements of several groups of objects in order.

    The error model takes the larger of each number: it is one statement for all rows.

    Raises:
        InputError: ``parts`` is empty.
    """
    if not parts:
        raise InputError("parts", "[]", "at least one VelocityMeasurement")
    return VelocityMeasurement(
        np.concatenate([p.mean_mps for p in parts]),
        np.concatenate([p.covariance_m2ps2 for p in parts]),
        np.concatenate([p.valid for p in parts]),
        _error_model(max, parts),
    )


def _error_model(
    choose: Callable[[Iterable[float]], float], parts: list[VelocityMeasurement]
) -> VelocityErrorModel:
    models = [part.error_model for part in parts]
    if all(model == models[0] for model in models):
        return models[0]
    # R_d by class belongs to one source alone
    names = (f.name for f in fields(VelocityErrorModel) if f.name != "class_variances")
    numbers = {name: choose(getattr(m, name) for m in models) for name in names}
    return replace(models[0], class_variances=(), **numbers)

"""What the points, boxes and poses of any data set must satisfy."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mottrack.core.arrays import F32, I16, Floats
from mottrack.core.checks import MAX_PLACE_M
from mottrack.core.errors import DataError
from mottrack.core.limits import MAX_POINTS, Limit
from mottrack.formats.columns import Columns
from mottrack.formats.faults import NonFiniteError, NotRigidError, TruncatedError
from mottrack.formats.files import read_bytes, require_size
from mottrack.formats.rigid import MAX_DEFECT, quaternion_length, upright_cosine

MAX_RANGE_M = 2_000.0
"""No LiDAR sees farther; a coordinate beyond it is a damaged file, not a return."""
MAX_BOX_RANGE_M = 1_000.0
"""No detector and no annotator sees farther from the vehicle."""
MAX_BOX_SIZE_M = 100.0
"""Longer than any road vehicle or tram."""
MAX_ANGLE_RAD = 4.0 * np.pi
"""Headings may be unwrapped; a larger one is in degrees, or damaged."""
RING_MAX = 1023.0
"""LiDARs have up to 128 beams, several together some hundreds."""
MIN_UPRIGHT_COSINE = 0.5
"""Of the angle between a box's z axis and the world's: no road is steeper than 60 degrees."""


def read_float_rows(path: Path, columns: int) -> F32:
    """Return a raw little-endian float32 file as (N, columns).

    Raises:
        DataError: the file is missing, empty or cut inside a row.
    """
    row_bytes = 4 * columns
    require_size(path, row_bytes * MAX_POINTS.value, MAX_POINTS.expected("points"))
    data = read_bytes(path)
    if not data or len(data) % row_bytes:
        expected = f"a positive multiple of {row_bytes} ({columns} float32 a point)"
        raise TruncatedError(path, "size in bytes", len(data), expected)
    return np.frombuffer(data, dtype="<f4").reshape(-1, columns).astype(np.float32)


def check_points(path: Path, xyz_m: Floats) -> None:
    """Raise `DataError` without points (N, 3), or for the first that no LiDAR can have measured."""
    if not len(xyz_m):
        raise DataError(path, "points", 0, "at least one")
    check_count(path, len(xyz_m))
    if xyz_m.min() >= -MAX_RANGE_M and xyz_m.max() <= MAX_RANGE_M:  # false of NaN
        return
    bad = np.flatnonzero(~np.isfinite(xyz_m).all(axis=1))
    if bad.size:
        raise NonFiniteError(path, f"point {bad[0]}", xyz_m[bad[0]].tolist(), "finite values")
    bad = np.flatnonzero(np.abs(xyz_m).max(axis=1) > MAX_RANGE_M)
    if bad.size:
        raise DataError(path, f"point {bad[0]}", xyz_m[bad[0]].tolist(), f"within {MAX_RANGE_M} m")


def check_rings(path: Path, ring: Floats) -> I16:
    """Return beam numbers (N,) in 16 bits; raise `DataError` for the first that no sensor has."""
    check_interval(path, "ring", ring, RING_MAX)
    return ring.astype(np.int16)


def check_count(path: Path, points: int, limit: Limit = MAX_POINTS) -> None:
    """Raise `DataError` for more points than any sensor makes in a revolution."""
    if points > limit.value:
        raise DataError(path, "points", points, limit.expected("points"))


def check_interval(path: Path, name: str, values: Floats, highest: float) -> None:
    """Raise `DataError` for the first value (N,) of the points that is not in [0, highest]."""
    if not values.size or (values.min() >= 0.0 and values.max() <= highest):  # false of NaN
        return
    bad = np.flatnonzero(~((values >= 0.0) & (values <= highest)))
    if bad.size:
        value = float(values[bad[0]])
        error = DataError if np.isfinite(value) else NonFiniteError
        raise error(path, f"{name} of point {bad[0]}", value, f"in [0, {highest:g}]")


def check_sizes(table: Columns, *names: str) -> None:
    """Raise `DataError` for the first length, width or height that is out of range."""
    for name in names:
        wrong = (table[name] <= 0.0) | (table[name] > MAX_BOX_SIZE_M)
        table.refuse(name, wrong, f"in (0, {MAX_BOX_SIZE_M:g}] m")


def check_ego_places(table: Columns, *names: str) -> None:
    """Raise `DataError` for the first coordinate that is too far from the vehicle."""
    for name in names:
        too_far = np.abs(table[name]) > MAX_BOX_RANGE_M
        table.refuse(name, too_far, f"within {MAX_BOX_RANGE_M:g} m of the vehicle")


def check_world_places(table: Columns, name: str = "translation") -> None:
    """Raise `DataError` for the first place (N, 3) that is nowhere near the Earth."""
    table.refuse(name, np.abs(table[name]) > MAX_PLACE_M, f"within {MAX_PLACE_M:g} m")


def check_headings(table: Columns, name: str) -> None:
    """Raise `DataError` for the first angle that cannot be one in radians."""
    too_large = np.abs(table[name]) > MAX_ANGLE_RAD
    table.refuse(name, too_large, "radians, at most two turns")


def check_rotations(table: Columns, *, tolerance: float = MAX_DEFECT) -> None:
    """Raise `DataError` for the first `rotation` (N, 4) that is not a unit quaternion."""
    off = np.abs(quaternion_length(table["rotation"]) - 1.0) > tolerance
    table.refuse("rotation", off, "a unit quaternion", NotRigidError)


def check_upright(table: Columns) -> None:
    """Raise `DataError` for the first `rotation` (N, 4) of a box that lies or hangs.

    Quaternions written as x, y, z, w and read as w, x, y, z turn boxes upside down.
    """
    lying = upright_cosine(table["rotation"]) < MIN_UPRIGHT_COSINE
    expected = "a box that stands upright, as w, x, y, z (are these x, y, z, w?)"
    table.refuse("rotation", lying, expected, NotRigidError)


def check_points_in_box(table: Columns, *names: str) -> None:
    """Raise `DataError` for the first number of returns in a box that no sensor counts."""
    for name in names:
        wrong = (table[name] < 0) | (table[name] > MAX_POINTS.value)
        table.refuse(name, wrong, f"in 0 .. {MAX_POINTS.value}")

"""Rigid transforms from files, in which rotations are rounded to a few digits."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mottrack.core import DataError, Pose
from mottrack.core.arrays import F64
from mottrack.core.checks import MAX_PLACE_M
from mottrack.formats.faults import NonFiniteError, NotRigidError

MAX_DEFECT = 1e-3
"""Largest |R R^T - I|, or | |q| - 1 |, taken for rounding: three digits are the fewest that files
are written with, and the gravest fault, a matrix of another meaning, is off by more."""


def rigid_pose(matrix: F64, file: Path, field: str) -> Pose:
    """Return the pose of a (3, 4) or (4, 4) matrix with its rotation made exactly orthonormal.

    Raises:
        DataError: not finite, farther than any place on Earth, or not a rotation by more than
            rounding explains.
    """
    rotation, translation = matrix[:3, :3], matrix[:3, 3]
    if not np.isfinite(matrix).all():
        raise NonFiniteError(file, field, matrix[:3].ravel().tolist(), "finite numbers")
    check_place(translation, file, field)
    # entries of a rotation are at most 1; the squares of a damaged number may overflow
    near = np.clip(rotation, -2.0, 2.0)
    defect = float(np.abs(near @ near.T - np.eye(3)).max())
    if defect > MAX_DEFECT or np.linalg.det(near) < 0.0:
        raise NotRigidError(file, field, f"off by {defect:.3g}", "a rotation matrix")
    left, _, right = np.linalg.svd(rotation)
    return Pose(left @ right, translation.copy())


def quaternion_pose(wxyz: F64, translation_m: F64, file: Path, field: str) -> Pose:
    """Return the pose of a quaternion (w, x, y, z) that is a unit one but for rounding.

    Raises:
        DataError: not finite, farther than any place on Earth, or not of unit length.
    """
    if not (np.isfinite(wxyz).all() and np.isfinite(translation_m).all()):
        raise NonFiniteError(
            file, field, [*wxyz.tolist(), *translation_m.tolist()], "finite numbers"
        )
    check_place(translation_m, file, field)
    length = float(quaternion_length(wxyz))
    if abs(length - 1.0) > MAX_DEFECT:
        raise NotRigidError(
            file, field, wxyz.tolist(), f"a unit quaternion, length is {length:.4g}"
        )
    return Pose.from_quaternion_wxyz(wxyz / length, translation_m)


def check_place(xyz_m: F64, file: Path, field: str) -> None:
    """Raise `DataError` for a place (3,) that is nowhere near the Earth."""
    if np.abs(xyz_m).max() > MAX_PLACE_M:
        raise DataError(file, field, f"at {xyz_m.tolist()} m", f"within {MAX_PLACE_M:g} m")


def quaternion_length(wxyz: F64) -> F64:
    """Return the length of (..., 4) quaternions, exact up to 10.

    A damaged number may be so large that its square overflows.
    """
    length: F64 = np.linalg.norm(np.clip(wxyz, -10.0, 10.0), axis=-1)
    return length


def quaternion_wxyz(rotation: F64) -> F64:
    """Return the unit quaternion (w, x, y, z), w >= 0, of a (3, 3) rotation.

    The eigenvector of largest eigenvalue of the symmetric matrix of Bar-Itzhack, "New method for
    extracting the quaternion from a rotation matrix", 2000: no case distinctions, no cancellation.
    """
    r = rotation
    trace = float(np.trace(r))
    vector = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    matrix = np.empty((4, 4))
    matrix[0, 0], matrix[0, 1:], matrix[1:, 0] = trace, vector, vector
    matrix[1:, 1:] = r + r.T - trace * np.eye(3)
    quaternion = np.linalg.eigh(matrix)[1][:, -1]
    return -quaternion if quaternion[0] < 0.0 else quaternion


def yaw_quaternions(yaw_rad: F64) -> F64:
    """Return (N, 4) quaternions (w, x, y, z) of rotations about +z."""
    zero = np.zeros_like(yaw_rad)
    return np.column_stack([np.cos(yaw_rad / 2), zero, zero, np.sin(yaw_rad / 2)])


def quaternion_yaws(wxyz: F64) -> F64:
    """Return the headings (N,) in [-pi, pi] of the x axis that (N, 4) quaternions rotate."""
    w, x, y, z = wxyz.T
    yaw_rad: F64 = np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return yaw_rad


def upright_cosine(wxyz: F64) -> F64:
    """Return the cosine (N,) of the angle between +z and the z axis that (N, 4) unit turn it to."""
    w, x, y, z = wxyz.T
    cosine: F64 = w * w - x * x - y * y + z * z
    return cosine

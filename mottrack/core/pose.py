"""Rigid transforms, named ``to_T_from``, and rotations about the vertical axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mottrack.core.arrays import F64, Floats
from mottrack.core.checks import as_array, require_finite, set_array
from mottrack.core.errors import InputError

ORTHONORMAL_TOLERANCE = 1e-6
"""Largest entry of R R^T - I: above the rounding of poses stored in float32 (1e-7), far below that
of a matrix with scale or shear. Also for the last row of a homogeneous matrix."""
UNIT_TOLERANCE = 1e-3
"""Error of a quaternion's norm; it is normalised then. Text files round to four digits and more."""


@dataclass(frozen=True, slots=True)
class Pose:
    """A rigid transform ``to_T_from``: ``x_to = rotation @ x_from + translation_m``.

    Raises:
        InputError: a shape is wrong, a number is not finite, or the rotation is not a rotation.
    """

    rotation: F64
    """(3, 3) rotation matrix, determinant +1."""
    translation_m: F64
    """(3,) translation in metres, in the axes of the target frame."""

    def __post_init__(self) -> None:
        rotation = set_array(self, "rotation", np.float64, (3, 3))
        translation_m = set_array(self, "translation_m", np.float64, (3,))
        require_finite("rotation", rotation)
        require_finite("translation_m", translation_m)
        error = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
        if error > ORTHONORMAL_TOLERANCE or np.linalg.det(rotation) < 0:
            raise InputError("rotation", rotation.tolist(), "an orthonormal right-handed matrix")

    @classmethod
    def identity(cls) -> Pose:
        """Return the identity transform."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_matrix(cls, matrix: ArrayLike) -> Pose:
        """Make a pose from a (4, 4) or (3, 4) homogeneous matrix, which is copied.

        Raises:
            InputError: the shape is another, or the last row is not 0, 0, 0, 1 (transposed?).
        """
        full = as_array("matrix", matrix, np.float64, (None, 4))
        if len(full) not in (3, 4):
            raise InputError("shape of matrix", full.shape, "(4, 4) or (3, 4)")
        if np.abs(full[3:] - [0.0, 0.0, 0.0, 1.0]).max(initial=0.0) > ORTHONORMAL_TOLERANCE:
            raise InputError("last row of matrix", full[3].tolist(), "[0, 0, 0, 1]")
        return cls(full[:3, :3].copy(), full[:3, 3].copy())

    @classmethod
    def from_quaternion_wxyz(cls, quaternion: ArrayLike, translation_m: ArrayLike) -> Pose:
        """Make a pose from a unit quaternion (w, x, y, z) and a translation in metres.

        Raises:
            InputError: the quaternion's norm is further than `UNIT_TOLERANCE` from one.
        """
        q = as_array("quaternion", quaternion, np.float64, (4,))
        require_finite("quaternion", q)
        norm = float(np.linalg.norm(q))
        if abs(norm - 1.0) > UNIT_TOLERANCE:
            raise InputError("norm of quaternion", norm, "1")
        w, x, y, z = q / norm
        rotation = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        return cls(rotation, as_array("translation_m", translation_m, np.float64, (3,)))

    @classmethod
    def from_yaw(cls, yaw_rad: float, translation_m: ArrayLike = (0.0, 0.0, 0.0)) -> Pose:
        """Make a pose from a rotation about +z by ``yaw_rad`` and a translation in metres."""
        return cls(rotation_z(yaw_rad), as_array("translation_m", translation_m, np.float64, (3,)))

    @property
    def matrix(self) -> F64:
        """(4, 4) homogeneous matrix."""
        full = np.eye(4)
        full[:3, :3], full[:3, 3] = self.rotation, self.translation_m
        return full

    @property
    def yaw_rad(self) -> float:
        """Angle of the rotation about +z that is nearest to the pose's rotation.

        The inverse pose has exactly the negative angle, so headings survive a round trip even
        where the pose pitches and rolls.
        """
        r = self.rotation
        return float(np.arctan2(r[1, 0] - r[0, 1], r[0, 0] + r[1, 1]))

    def inverse(self) -> Pose:
        """Return ``from_T_to``."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation_m)

    def __matmul__(self, other: Pose) -> Pose:
        """Return ``a_T_c``, which is ``a_T_b @ b_T_c``."""
        return Pose(
            _nearest_rotation(self.rotation @ other.rotation),
            self.rotation @ other.translation_m + self.translation_m,
        )

    def apply(self, points_m: Floats) -> F64:
        """Transform (N, 3) points in metres from the source frame to the target frame."""
        return np.asarray(points_m, dtype=np.float64) @ self.rotation.T + self.translation_m


def rotation_z(yaw_rad: float) -> F64:
    """Return the (3, 3) rotation about +z."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation_2d(yaw_rad: float) -> F64:
    """Return the (2, 2) rotation of the ground plane."""
    return rotation_z(yaw_rad)[:2, :2]


def wrap_angle(angle_rad: F64) -> F64:
    """Return angles wrapped to [-pi, pi)."""
    return (angle_rad + np.pi) % (2 * np.pi) - np.pi


def _nearest_rotation(rotation: F64) -> F64:
    """Remove the rounding that long chains of products accumulate (one Newton step)."""
    return np.asarray(0.5 * rotation @ (3.0 * np.eye(3) - rotation.T @ rotation))

"""The solids that a ray can hit, as a structure of arrays that numba takes as one argument."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I8, I16, I64, Mask
from mottrack.world.materials import Surface

BOX, CYLINDER, ELLIPSOID = 0, 1, 2
BACKGROUND = -1


class Solids(NamedTuple):
    """P upright solids at the stamp of a sweep, world frame, moving on parabolas.

    Within the 0.1 s of a scan ``centre(tau) = centre + velocity tau + acceleration tau^2 / 2`` and
    ``yaw(tau) = yaw + yaw_rate tau`` hold to a millimetre.
    """

    kind: I8
    """(P,) BOX, CYLINDER (upright, elliptic) or ELLIPSOID."""
    centre_m: F64
    """(P, 3)"""
    half_m: F64
    """(P, 3) half extents along its own axes."""
    yaw_rad: F64
    """(P,) heading of its x axis."""
    chamfer_m: F64
    """(P, 2) of a box: cut off the upright edges, cut off the front and rear upper edges."""
    velocity_mps: F64
    """(P, 3)"""
    acceleration_mps2: F64
    """(P, 3)"""
    yaw_rate_radps: F64
    """(P,)"""
    material: I16
    """(P,) row of the material table."""
    albedo: F64
    """(P,) diffuse reflectivity in [0, 1]."""
    owner: I64
    """(P,) row of the agent that it belongs to, BACKGROUND for the static world."""


class SolidPose(NamedTuple):
    """Where a solid is at one time, world frame."""

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float


@compiled
def solid_pose_at(solids: Solids, p: int, tau_s: float) -> SolidPose:
    """Return the pose of solid ``p`` at a time relative to the stamp."""
    half = 0.5 * tau_s * tau_s
    centre, velocity, acceleration = solids.centre_m, solids.velocity_mps, solids.acceleration_mps2
    return SolidPose(
        centre[p, 0] + tau_s * velocity[p, 0] + half * acceleration[p, 0],
        centre[p, 1] + tau_s * velocity[p, 1] + half * acceleration[p, 1],
        centre[p, 2] + tau_s * velocity[p, 2] + half * acceleration[p, 2],
        solids.yaw_rad[p] + tau_s * solids.yaw_rate_radps[p],
    )


class SolidsBuilder:
    """A list of resting solids that grows."""

    def __init__(self) -> None:
        self._rows: list[list[float]] = []

    def add(
        self,
        kind: int,
        centre_m: Sequence[float],
        half_m: Sequence[float],
        surface: Surface,
        yaw_rad: float = 0.0,
    ) -> None:
        """Add one solid with uncut edges."""
        self._rows.append([kind, *centre_m, *half_m, yaw_rad, 0.0, 0.0, *surface])

    def add_box(
        self,
        centre_m: Sequence[float],
        half_m: Sequence[float],
        surface: Surface,
        yaw_rad: float = 0.0,
        chamfer_m: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Add a box, its upright and its upper edges cut off by ``chamfer_m``."""
        self._rows.append([BOX, *centre_m, *half_m, yaw_rad, *chamfer_m, *surface])

    def build(self) -> Solids:
        """Return all solids, at rest and part of the background."""
        table = np.array(self._rows, dtype=np.float64).reshape(-1, 12)
        n = len(table)
        return Solids(
            kind=table[:, 0].astype(np.int8),
            centre_m=table[:, 1:4].copy(),
            half_m=table[:, 4:7].copy(),
            yaw_rad=table[:, 7].copy(),
            chamfer_m=table[:, 8:10].copy(),
            velocity_mps=np.zeros((n, 3)),
            acceleration_mps2=np.zeros((n, 3)),
            yaw_rate_radps=np.zeros(n),
            material=table[:, 10].astype(np.int16),
            albedo=table[:, 11].copy(),
            owner=np.full(n, BACKGROUND, dtype=np.int64),
        )


def concatenate(parts: Sequence[Solids]) -> Solids:
    """Return all solids of all parts, in that order."""
    together: list[Any] = [np.concatenate(arrays) for arrays in zip(*parts, strict=True)]
    return Solids(*together)


def select(solids: Solids, index: Mask | I64) -> Solids:
    """Return the solids that a mask or an index picks."""
    picked: list[Any] = [array[index] for array in solids]
    return Solids(*picked)

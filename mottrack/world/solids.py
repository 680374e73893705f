"""The shapes that a ray can hit, as a structure of arrays that numba takes as one argument."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I8, I16, I64, Mask

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
    """(P, 3) middle of the solid."""
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
    """(P,) row of the mover that it belongs to, BACKGROUND for the static world."""


class SolidsBuilder:
    """Collects resting solids one by one or by the row."""

    def __init__(self) -> None:
        self._rows: list[F64] = []

    def add(
        self,
        kind: int,
        centre_m: Sequence[float],
        half_m: Sequence[float],
        yaw_rad: float = 0.0,
        surface: tuple[int, float] = (0, 0.3),
    ) -> None:
        """Adds one solid; ``surface`` is (material, albedo)."""
        row = [kind, *centre_m, *half_m, yaw_rad, 0.0, 0.0, *surface]
        self._rows.append(np.array([row]))

    def add_box_with_cuts(
        self,
        centre_m: Sequence[float],
        half_m: Sequence[float],
        cuts_m: tuple[float, float],
        surface: tuple[int, float],
    ) -> None:
        """Adds a box whose upright and upper edges are cut off by ``cuts_m`` (local frame)."""
        self._rows.append(np.array([[BOX, *centre_m, *half_m, 0.0, *cuts_m, *surface]]))

    def build(self, owner: int = BACKGROUND) -> Solids:
        """All solids, at rest, of one owner."""
        table = np.concatenate(self._rows) if self._rows else np.zeros((0, 12))
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
            owner=np.full(n, owner, dtype=np.int64),
        )


def concatenate(parts: Sequence[Solids]) -> Solids:
    """All solids of all parts, in that order."""
    together: list[Any] = [np.concatenate(arrays) for arrays in zip(*parts, strict=True)]
    return Solids(*together)


def select(solids: Solids, index: Mask | I64) -> Solids:
    """The solids that a mask or an index picks."""
    picked: list[Any] = [array[index] for array in solids]
    return Solids(*picked)

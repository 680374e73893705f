"""Region of interest: the part of every frame that scores count."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, Self

import numpy as np
import shapely
from pydantic import Field, model_validator

from mottrack.config import StrictModel
from mottrack.core import SceneResult
from mottrack.core.arrays import F64, Mask
from mottrack.core.scene_objects import SceneObjects
from mottrack.core.tables import TrackTable, TruthTable


class Region(StrictModel):
    """A ring around the vehicle, a polygon, or what lies in both.

    A box belongs to it by its centre, a cell of the flow by its own; both over the ground.
    """

    min_range_m: float = Field(
        default=0.0, ge=0, description="nearer to the vehicle's origin is left out"
    )
    max_range_m: float | None = Field(
        default=None, gt=0, description="at least this far from it is left out; null: no limit"
    )
    polygon: tuple[tuple[float, float], ...] | None = Field(
        default=None,
        description="vertices [x, y] in metres, in order, as the outer ring of a GeoJSON polygon: "
        "the first may be repeated at the end; the boundary belongs to it; null: no polygon",
    )
    frame: Literal["ego", "world"] = Field(
        default="ego", description="frame of the polygon: it moves with the vehicle, or stands"
    )

    @model_validator(mode="after")
    def _is_a_region(self) -> Self:
        if self.max_range_m is not None and self.max_range_m <= self.min_range_m:
            raise ValueError(
                f"max_range_m is {self.max_range_m:g}, expected more than min_range_m, "
                f"{self.min_range_m:g}"
            )
        if self.polygon is None:
            return self
        corners = len(set(self.polygon))
        if corners < 3:
            raise ValueError(f"polygon has {corners} different vertices, expected at least 3")
        shape = shapely.Polygon(self.polygon)
        if not shape.is_valid:
            raise ValueError(
                f"polygon is not simple ({shapely.is_valid_reason(shape)}), expected vertices in "
                "order around an area"
            )
        return self

    def crop(self, result: SceneResult, *, truth: bool = True) -> SceneResult:
        """Return the scene with what lies in the region alone.

        Args:
            result: of the scene, in any world frame.
            truth: whether true boxes are left out too; a track at the border may lie on an object
                whose centre is just beyond it.
        """
        inside = self.holds(result, result.tracks)
        hulls = [hull for hull, kept in zip(result.hulls, inside, strict=True) if kept]
        return replace(
            result,
            truth=result.truth.select(self.holds(result, result.truth)) if truth else result.truth,
            tracks=result.tracks.select(inside),
            hull_xy_m=np.concatenate([np.zeros((0, 2)), *hulls]),
            flow=result.flow.select(self._cells(result)),
        )

    def holds(self, result: SceneResult, table: TruthTable | TrackTable | SceneObjects) -> Mask:
        """Return (N,) whether the centres of boxes of a scene lie in the region."""
        world_T_ego = result.frames.world_T_ego[table.frame]
        from_ego = table.centre_m - world_T_ego[:, :3, 3]
        ego_xy_m = np.einsum("nij,ni->nj", world_T_ego[:, :3, :2], from_ego)
        return self._contains(ego_xy_m, table.centre_m[:, :2])

    def _cells(self, result: SceneResult) -> Mask:
        world_T_ego = result.frames.world_T_ego[result.flow.frame]
        ego_xy_m = result.flow.xy_m.astype(np.float64)
        world_xy_m = np.einsum("nij,nj->ni", world_T_ego[:, :2, :2], ego_xy_m)
        return self._contains(ego_xy_m, world_xy_m + world_T_ego[:, :2, 3])

    def _contains(self, ego_xy_m: F64, world_xy_m: F64) -> Mask:
        range_m = np.hypot(*ego_xy_m.T)
        inside: Mask = (range_m >= self.min_range_m) & (range_m < (self.max_range_m or np.inf))
        if self.polygon is not None:
            shape = shapely.Polygon(self.polygon)
            xy_m = ego_xy_m if self.frame == "ego" else world_xy_m
            inside &= shapely.intersects_xy(shape, *xy_m.T)
        return inside

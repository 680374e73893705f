"""Class-agnostic objects: clusters of LiDAR points above the ground (paper, section V-A)."""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from mottrack.config import StrictModel
from mottrack.core.arrays import F64, I64
from mottrack.core.errors import InputError
from mottrack.core.frame import Frame
from mottrack.core.interfaces import GroundMap
from mottrack.core.objects import Objects
from mottrack.core.sweep import Sweep
from mottrack.geometry.hulls import HullSet, hulls_of_groups
from mottrack.lidar.ground import GroundConfig, find_ground
from mottrack.lidar.terrain import Terrain, TerrainConfig
from mottrack.objects.cluster_points import ClusterPoints, group_points, kept_points
from mottrack.objects.clustering import box_mask, component_labels, split_large
from mottrack.objects.reference import ReferenceConfig, position_covariance, reference_points


class MaskConfig(StrictModel):
    """The dilated mask of a detector's boxes, the constraint on the labels."""

    enabled: bool = Field(True, description="use the frame's detections where there are any")
    margin_m: float = Field(0.3, ge=0, description="boxes grow by this on each side")
    min_score: float = Field(0.3, description="detections below this score are no constraint")


class ClustersConfig(StrictModel):
    """How points become clusters."""

    ground: Literal["terrain", "plane"] = Field(
        "terrain",
        description="map's raster or height map over sweeps; or RANSAC plane of each sweep",
    )
    min_height_m: float = Field(0.3, description="lowest kept height above ground")
    max_height_m: float = Field(2.0, description="highest kept height; above the lowest")
    min_range_m: float = Field(2.5, ge=0, description="nearer points lie on the vehicle itself")
    reach_m: float = Field(
        50.0, gt=0, le=500, description="half side of the square around the vehicle"
    )
    cell_m: float = Field(0.25, gt=0, le=5, description="side of an occupancy cell")
    join_cells: int = Field(1, ge=0, le=10, description="gaps of twice this many cells are bridged")
    min_points: int = Field(4, ge=1, description="smaller clusters are dropped")
    tile_m: float = Field(10.0, ge=0, description="pieces of components over twice this; 0: whole")
    mask: MaskConfig = Field(default_factory=MaskConfig)
    reference: ReferenceConfig = Field(default_factory=ReferenceConfig)
    terrain: TerrainConfig = Field(default_factory=TerrainConfig)
    plane: GroundConfig = Field(default_factory=GroundConfig)

    @model_validator(mode="after")
    def _band_has_a_height(self) -> Self:
        if not self.min_height_m < self.max_height_m:
            raise ValueError(
                f"max_height_m is {self.max_height_m}, expected above min_height_m "
                f"({self.min_height_m})"
            )
        return self


class ClusterSource:
    """Finds clusters sweep by sweep; remembers the terrain of a scene."""

    Config = ClustersConfig
    needs_sweeps = True

    def __init__(self, config: ClustersConfig | None = None) -> None:
        self.config = config or ClustersConfig()
        self._terrain = Terrain(self.config.terrain)
        self._map: GroundMap | None = None

    def use_ground(self, ground: GroundMap) -> None:
        """Takes heights from a map's raster; where that knows none, from the estimate."""
        self._map = ground if self.config.ground == "terrain" else None

    def reset(self) -> None:
        """Forgets the terrain and the map: a new scene begins."""
        self._terrain.reset()
        self._map = None

    def objects(self, frame: Frame, sweep: Sweep | None) -> Objects:
        """Clusters in the world frame, all of label "generic", with hull and position covariance.

        Raises:
            InputError: there is no sweep.
        """
        if sweep is None:
            raise InputError("sweep", "absent", "a scene with LiDAR sweeps, or objects=detections")
        config = self.config
        # the square turns with the vehicle, the grid around it does not
        yaw_rad = sweep.world_T_ego.yaw_rad
        wider = abs(np.cos(yaw_rad)) + abs(np.sin(yaw_rad))
        cells = 2 * int(np.ceil(wider * config.reach_m / config.cell_m))
        centre = np.round(sweep.world_T_ego.translation_m[:2] / config.cell_m).astype(np.int64)
        corner = centre - cells // 2
        corner_m = np.asarray(corner * config.cell_m, np.float64)
        points = kept_points(sweep, self._heights_m(sweep), corner_m, self._limits(), cells)
        occupied = np.zeros((cells, cells), np.bool_)
        occupied[points.row, points.column] = True
        owner = self._mask(frame, corner_m, occupied.shape)
        labels = component_labels(occupied, owner, config.join_cells)
        if config.tile_m > 0:
            tile = max(round(config.tile_m / config.cell_m), 1)
            labels = split_large(labels, tile, (int(corner[1]), int(corner[0])))
        cluster = labels.of(points.row, points.column, occupied.shape)
        groups = group_points(points, cluster, labels.number, config.min_points)
        return self._described(sweep, groups, corner_m)

    def _limits(self) -> tuple[float, float, float, float, float]:
        config = self.config
        return (
            config.min_height_m,
            config.max_height_m,
            config.min_range_m,
            config.reach_m,
            config.cell_m,
        )

    def _heights_m(self, sweep: Sweep) -> F64:
        """(N,) heights above ground."""
        if self.config.ground == "plane":
            plane = find_ground(np.array(sweep.xyz_m), self.config.plane).plane
            return np.asarray(sweep.xyz_m[:, 2] - sweep.xyz_m[:, :2] @ plane[:2] - plane[2], float)
        self._terrain.update(sweep)
        estimate_m = self._terrain.height_above_m(sweep)
        if self._map is None:
            return estimate_m
        world_m = sweep.world_T_ego.apply(sweep.xyz_m)
        mapped_m = world_m[:, 2] - self._map.ground_height(world_m[:, :2])
        return np.where(np.isnan(mapped_m), estimate_m, mapped_m)

    def _mask(self, frame: Frame, corner_m: F64, shape: tuple[int, ...]) -> I64 | None:
        """(H, W) which detection each cell belongs to, or None where there are none."""
        mask = self.config.mask
        if not mask.enabled or frame.detections is None:
            return None
        found = frame.detections.select(frame.detections.score >= mask.min_score)
        size_m = found.size_m[:, :2] + 2 * mask.margin_m
        boxes = np.column_stack([found.centre_m[:, :2] - corner_m, size_m, found.yaw_rad])
        owner: I64 = box_mask(boxes, (shape[0], shape[1]), self.config.cell_m)
        return owner

    def _described(self, sweep: Sweep, groups: ClusterPoints, corner_m: F64) -> Objects:
        """Position, size, hull and covariance of each group of points."""
        hulls = hulls_of_groups(groups.xy_m, groups.start)
        sensor_m = sweep.world_T_ego.apply(sweep.origin_m[None])[0, :2] - corner_m
        chosen = self.config.reference
        centre_m = reference_points(chosen.rule, hulls, groups, sensor_m) + corner_m
        height_m = np.maximum(groups.top_m - groups.bottom_m, 0.1)
        middle_m = 0.5 * (groups.top_m + groups.bottom_m)
        rectangle = hulls.rectangle
        count = np.diff(groups.start)
        return Objects(
            stamp_ns=sweep.stamp_ns,
            frame="world",
            centre_m=np.column_stack([centre_m, middle_m]),
            size_m=np.column_stack([np.maximum(rectangle[:, 2:4], 0.1), height_m]),
            yaw_rad=rectangle[:, 4],
            label=np.full(len(count), "generic"),
            score=count / (count + 10.0),
            hull=_moved(hulls, corner_m),
            position_covariance_m2=position_covariance(rectangle, count, chosen),
            num_points=count,
        )


def _moved(hulls: HullSet, corner_m: F64) -> tuple[F64, ...]:
    return HullSet(hulls.corner_m + corner_m, *hulls[1:]).polygons()

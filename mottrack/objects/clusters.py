"""Class-agnostic objects: clusters of LiDAR points above the ground (paper, section V-A)."""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from mottrack.config import StrictModel
from mottrack.core.arrays import F64, I64
from mottrack.core.errors import InputError
from mottrack.core.frame import Frame
from mottrack.core.interfaces import GroundMap, ObjectSourceBase
from mottrack.core.objects import GENERIC, Objects
from mottrack.core.sweep import Sweep, has_jumped
from mottrack.geometry.hulls import HullSet, hulls_of_groups
from mottrack.lidar.ground import GroundConfig, find_ground
from mottrack.lidar.terrain import Terrain, TerrainConfig
from mottrack.objects.cluster_points import (
    ClusterPoints,
    PointLimits,
    group_points,
    obstacle_points,
)
from mottrack.objects.clustering import box_mask, component_labels, split_large

SMALLEST_M = 0.1
"""Of a cluster's box: a few points may lie on one line, and a box needs a size."""
HALF_SCORE_POINTS = 10.0
"""Points of a cluster of score 0.5: a ranking that grows with the number of points."""

Rule = Literal["hull_centroid", "rectangle_centre", "nearest_corner", "cell_mean"]


class ReferenceConfig(StrictModel):
    """Reference point of a cluster and the covariance of its error."""

    rule: Rule = Field("cell_mean", description="which point of the cluster is its position")
    sampling_m: float = Field(0.03, gt=0, description="standard deviation with dense points")
    spacing_m: float = Field(0.1, ge=0, description="added over the root of the point count")
    extent_share: float = Field(0.02, ge=0, description="added per metre of extent")
    extent_spacing: float = Field(
        0.5, ge=0, description="added per metre of extent over the root of the point count"
    )


class MaskConfig(StrictModel):
    """Dilated mask of a detector's boxes, which constrains the components."""

    enabled: bool = Field(True, description="use the frame's detections if there are any")
    margin_m: float = Field(0.3, ge=0, description="boxes grow by this on each side")
    min_score: float = Field(0.3, description="detections below this score are ignored")


class ClustersConfig(StrictModel):
    """How points become clusters."""

    ground: Literal["terrain", "plane"] = Field(
        "terrain",
        description="the map's raster or a height map over sweeps; or a RANSAC plane per sweep",
    )
    min_height_m: float = Field(0.3, description="lowest kept height above ground")
    max_height_m: float = Field(2.0, description="highest kept height; above the lowest")
    min_range_m: float = Field(2.5, ge=0, description="nearer points lie on the vehicle")
    reach_m: float = Field(
        50.0, gt=0, le=500, description="half side of the square around the vehicle"
    )
    cell_m: float = Field(0.25, gt=0, le=5, description="side of an occupancy cell")
    join_cells: int = Field(
        1, ge=0, le=10, description="gaps of up to twice this many cells are bridged"
    )
    min_points: int = Field(4, ge=1, description="smaller clusters are dropped")
    tile_m: float = Field(
        10.0, ge=0, description="components longer than twice this are cut into tiles; 0: never"
    )
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


class ClusterSource(ObjectSourceBase):
    """Clusters the points of each sweep; keeps a terrain estimate over the scene."""

    Config = ClustersConfig

    def __init__(self, config: ClustersConfig | None = None) -> None:
        self.config = config or ClustersConfig()
        self._terrain = Terrain(self.config.terrain)
        self._map: GroundMap | None = None
        self._last: Sweep | None = None
        """The stamp and the pose of the last sweep, without its points."""

    def use_ground(self, ground: GroundMap) -> None:
        """Use the heights of a map's raster, and the estimate where the map has none."""
        self._map = ground if self.config.ground == "terrain" else None

    def reset(self) -> None:
        """Start a new scene: forget the terrain and the map."""
        self._terrain.reset()
        self._last = None
        self._map = None

    def objects(self, frame: Frame, sweep: Sweep | None) -> Objects:
        """Return clusters in the world frame, label "generic", with hull and position covariance.

        Raises:
            InputError: there is no sweep.
        """
        if sweep is None:
            raise InputError("sweep", "absent", "a scene with LiDAR sweeps, or objects=detections")
        config = self.config
        # the square rotates with the vehicle, the grid around it does not
        yaw_rad = sweep.world_T_ego.yaw_rad
        wider = abs(np.cos(yaw_rad)) + abs(np.sin(yaw_rad))
        cells = 2 * int(np.ceil(wider * config.reach_m / config.cell_m))
        centre = np.round(sweep.world_T_ego.translation_m[:2] / config.cell_m).astype(np.int64)
        corner = centre - cells // 2
        corner_m = np.asarray(corner * config.cell_m, np.float64)
        limits = PointLimits(
            config.min_height_m,
            config.max_height_m,
            config.min_range_m,
            config.reach_m,
            config.cell_m,
        )
        points = obstacle_points(sweep, self._heights_m(sweep), corner_m, limits, cells)
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

    def _heights_m(self, sweep: Sweep) -> F64:
        """Return (N,) heights above ground."""
        if self.config.ground == "plane":
            plane = find_ground(np.array(sweep.xyz_m), self.config.plane).plane
            return np.asarray(sweep.xyz_m[:, 2] - sweep.xyz_m[:, :2] @ plane[:2] - plane[2], float)
        if self._last is not None and has_jumped(self._last, sweep):
            self._terrain.reset()  # what was ground there lies elsewhere now
        self._last = sweep.select(np.zeros(0, np.int64))
        self._terrain.update(sweep)
        estimate_m = self._terrain.height_above_m(sweep)
        if self._map is None:
            return estimate_m
        world_m = sweep.world_T_ego.apply(sweep.xyz_m)
        mapped_m = world_m[:, 2] - self._map.ground_height(world_m[:, :2])
        return np.where(np.isnan(mapped_m), estimate_m, mapped_m)

    def _mask(self, frame: Frame, corner_m: F64, shape: tuple[int, ...]) -> I64 | None:
        """Return (H, W) the detection that each cell belongs to, or None without detections."""
        mask = self.config.mask
        if not mask.enabled or frame.detections is None:
            return None
        found = frame.detections.select(frame.detections.score >= mask.min_score)
        size_m = found.size_m[:, :2] + 2 * mask.margin_m
        boxes = np.column_stack([found.centre_m[:, :2] - corner_m, size_m, found.yaw_rad])
        return box_mask(boxes, (shape[0], shape[1]), self.config.cell_m)

    def _described(self, sweep: Sweep, groups: ClusterPoints, corner_m: F64) -> Objects:
        """Return position, size, hull and covariance of each group of points."""
        hulls = hulls_of_groups(groups.xy_m, groups.start)
        sensor_m = sweep.world_T_ego.apply(sweep.origin_m[None])[0, :2] - corner_m
        chosen = self.config.reference
        centre_m = reference_points(chosen.rule, hulls, groups, sensor_m) + corner_m
        height_m = np.maximum(groups.top_m - groups.bottom_m, SMALLEST_M)
        middle_m = 0.5 * (groups.top_m + groups.bottom_m)
        rectangle = hulls.rectangle
        count = np.diff(groups.start)
        return Objects(
            stamp_ns=sweep.stamp_ns,
            frame="world",
            centre_m=np.column_stack([centre_m, middle_m]),
            size_m=np.column_stack([np.maximum(rectangle[:, 2:4], SMALLEST_M), height_m]),
            yaw_rad=rectangle[:, 4],
            label=np.full(len(count), GENERIC),
            score=count / (count + HALF_SCORE_POINTS),
            hull=HullSet(hulls.corner_m + corner_m, *hulls[1:]).polygons(),
            position_covariance_m2=position_covariance(rectangle, count, chosen),
            num_points=count,
        )


def reference_points(rule: Rule, hulls: HullSet, groups: ClusterPoints, sensor_m: F64) -> F64:
    """Return (G, 2) reference point of each cluster; `sensor_m` (2,) is the optical centre."""
    if rule == "hull_centroid":
        return hulls.centroid_m
    if rule == "cell_mean":
        return groups.cell_mean_m
    centre_m = hulls.rectangle[:, :2]
    return centre_m if rule == "rectangle_centre" else _nearest_corner(hulls.rectangle, sensor_m)


def _nearest_corner(rectangle: F64, sensor_m: F64) -> F64:
    along = np.stack([np.cos(rectangle[:, 4]), np.sin(rectangle[:, 4])], axis=1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    towards = sensor_m - rectangle[:, :2]
    a = np.sign(np.einsum("gi,gi->g", along, towards)) * rectangle[:, 2] / 2
    b = np.sign(np.einsum("gi,gi->g", across, towards)) * rectangle[:, 3] / 2
    return np.asarray(rectangle[:, :2] + a[:, None] * along + b[:, None] * across)


def position_covariance(rectangle: F64, num_points: I64, config: ReferenceConfig) -> F64:
    """Return (G, 2, 2) covariance of the reference point's error.

    Along each side of the smallest rectangle: sampling, and a share of the extent, because the
    visible part of a long cluster moves along it. Fewer points make both larger. The form was
    chosen on jumps measured in the embedded world (benchmarks/cluster_reference.py).
    """
    count = np.maximum(num_points, 1)
    sampling = config.sampling_m**2 + config.spacing_m**2 / count
    share = config.extent_share**2 + config.extent_spacing**2 / count
    variance = sampling[:, None] + share[:, None] * rectangle[:, 2:4] ** 2
    cos, sin = np.cos(rectangle[:, 4]), np.sin(rectangle[:, 4])
    turn = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
    covariance = (turn * variance[:, None, :]) @ turn.transpose(0, 2, 1)
    return np.asarray(0.5 * (covariance + covariance.transpose(0, 2, 1)))

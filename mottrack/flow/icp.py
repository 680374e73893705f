"""ICP + Det.: the paper's learning-free baseline (section IV-C).

"We select the 3-D points within the clusters, and then apply ICP to obtain the transform between
the two point clouds." The points of each detection box are registered to the previous sweep with
small-gicp. One start is the paper's form; several starts, compared by what they leave unexplained
in both directions, are the fair one: ICP only finds the nearest minimum, and a car at 15 m/s is
1.5 m away from its last place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import small_gicp
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import F32, F64, I64
from mottrack.core.frame import Frame
from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import FlowSourceBase
from mottrack.core.motion import FlowField
from mottrack.core.objects import Boxes
from mottrack.core.pose import rotation_2d
from mottrack.core.sweep import Sweep, seconds_between
from mottrack.flow.shipped_errors import shipped_errors
from mottrack.flow.sweep_pair.elapsed import elapsed_seconds
from mottrack.flow.sweep_pair.obstacle_points import GroundStage, keep_points
from mottrack.lidar.in_boxes import points_in_boxes
from mottrack.lidar.point_grid import PointGrid, build_point_grid
from mottrack.lidar.residual import box_residual, capped_residual, capped_residuals
from mottrack.lidar.thinning import first_in_voxel

_VOXEL_M = 0.1
_NOT_MEASURED = np.full(2, np.nan)


class IcpConfig(StrictModel):
    """How objects are registered."""

    ground: GroundStage = Field(default_factory=GroundStage)
    starts: int = Field(6, ge=1, description="starts per object; 1: from rest only, as the paper")
    use_truth: bool = Field(False, description="boxes of the truth in place of detections")
    margin_m: float = Field(0.15, ge=0, description="boxes grow by this on each side")
    min_points: int = Field(11, ge=11, description="small-gicp registers no smaller clusters")
    max_points: int = Field(400, ge=11, description="larger clusters are thinned evenly")
    advantage_m: float = Field(
        0.02, ge=0, description="a far start must explain better by this than a start from rest"
    )
    min_score: float = Field(0.0, description="boxes below this score are not registered")
    max_speed_mps: float = Field(40.0, gt=0, description="fastest start and fastest result")
    gate_m: float = Field(0.5, gt=0, description="farthest pair, and the cap of the residual")
    worst_residual_m: float = Field(0.3, gt=0, description="a worse match is not a measurement")
    sigma_m: float = Field(0.03, gt=0, description="noise of one coordinate of a registration")


@dataclass(frozen=True, slots=True)
class _Pair:
    """What one registration needs of the two sweeps."""

    target: small_gicp.PointCloud
    tree: small_gicp.KdTree
    grid: PointGrid
    elapsed_s: float


@dataclass(frozen=True, slots=True)
class _Memory:
    """Objects of the step before, in the world: where they were and how they moved."""

    centre_m: F64
    velocity_mps: F64
    stamp_ns: int


class IcpFlow(FlowSourceBase):
    """Velocity of each box's points by registration to the previous, ego-aligned sweep."""

    Config = IcpConfig

    def __init__(self, config: IcpConfig | None = None, *, grid: BevGrid | None = None) -> None:
        self.config = config or IcpConfig()
        self.grid = grid or BevGrid()
        self.errors_name = "icp" if self.config.starts > 1 else "icp_one_start"
        self.error_model = shipped_errors(self.errors_name)
        self._ground = self.config.ground.reaching(self.grid)
        self._boxes: Boxes | None = None
        self._memory: _Memory | None = None

    def observe(self, frame: Frame) -> None:
        """Takes the boxes of a frame: detections, or truth where the configuration says so."""
        self._boxes = frame.truth if self.config.use_truth else frame.detections

    def reset(self) -> None:
        """Forgets boxes and velocities: a new scene begins."""
        self._boxes, self._memory = None, None

    def estimate(self, previous: Sweep, current: Sweep) -> FlowField:
        """The field of the boxes observed last; cells outside every box are not valid.

        Raises:
            InputError: ``current`` is not later than ``previous``.
        """
        elapsed_s = elapsed_seconds(previous, current)
        kept, _ = keep_points(current, self._ground)
        then, _ = keep_points(previous, self._ground)
        previous_m = then.seen_from(current).xyz_m
        boxes = self._current_boxes(current)
        if boxes is None or len(previous_m) < self.config.min_points or len(kept) == 0:
            occupied = self.grid.occupancy(kept.xyz_m)
            return FlowField.unmeasured(self.grid, occupied, current.stamp_ns)
        pair = _prepared(np.array(previous_m), elapsed_s, self.config.gate_m)
        inside = points_in_boxes(
            kept.xyz_m, boxes.centre_m, boxes.size_m, boxes.yaw_rad, self.config.margin_m
        )
        shifts_m = np.full((len(boxes), 2), np.nan)
        for b in range(len(boxes)):
            cluster_m = self._thinned(kept.xyz_m[inside.of(b)])
            shifts_m[b] = self._register(cluster_m, boxes.select(np.array([b])), pair, current)
        velocity_mps = -shifts_m / elapsed_s
        self._remember(boxes, velocity_mps, current)
        return self._field(kept, inside.first_box(len(kept)), velocity_mps, elapsed_s)

    def _current_boxes(self, current: Sweep) -> Boxes | None:
        if self._boxes is None or self._boxes.stamp_ns != current.stamp_ns:
            return None
        boxes: Boxes = self._boxes.transformed(current.world_T_ego.inverse(), "ego")
        score = getattr(boxes, "score", None)
        return boxes if score is None else boxes.select(score >= self.config.min_score)

    def _thinned(self, cluster_m: F32) -> F32:
        return np.array(cluster_m[:: max(len(cluster_m) // self.config.max_points, 1)])

    def _register(self, cluster_m: F32, box: Boxes, pair: _Pair, current: Sweep) -> F64:
        """Planar shift (2,) of a cluster to where it was; NaN where that cannot be told."""
        if len(cluster_m) < self.config.min_points:
            return _NOT_MEASURED
        centre_m = cluster_m.mean(axis=0)
        own_grid = build_point_grid(cluster_m - centre_m, self.config.gate_m, _reach(box))
        best_m, best_residual_m = _NOT_MEASURED, self.config.worst_residual_m
        for k, start_m in enumerate(self._starts(cluster_m, box, pair, current)):
            shift_m = self._align(cluster_m, start_m, pair)
            if not np.hypot(*shift_m) <= self.config.max_speed_mps * pair.elapsed_s:
                continue
            x_m, y_m = float(shift_m[0]), float(shift_m[1])
            forward_m = capped_residual(pair.grid, cluster_m, (x_m, y_m), self.config.gate_m)
            moved = _moved_box(box, shift_m, self.config.margin_m)
            offset_m = (x_m + centre_m[0], y_m + centre_m[1], centre_m[2])
            backward_m = box_residual(pair.grid, own_grid, moved, offset_m, self.config.gate_m)
            residual_m = 0.5 * (forward_m + backward_m) - (self.config.advantage_m if k == 0 else 0)
            if residual_m < best_residual_m:
                best_m, best_residual_m = shift_m, residual_m
        return best_m

    def _starts(self, cluster_m: F32, box: Boxes, pair: _Pair, current: Sweep) -> F64:
        """(K, 2) planar shifts to start from: rest, the last velocity, and the best of a spread."""
        rest = np.zeros((1, 2))
        if self.config.starts == 1:
            return rest
        spread_m = _spread(float(box.yaw_rad[0]), self.config.max_speed_mps * pair.elapsed_s)
        residual_m = capped_residuals(pair.grid, cluster_m, spread_m, self.config.gate_m)
        best = np.argsort(residual_m, kind="stable")[: self.config.starts - 1]
        remembered_m = -self._last_velocities(box, current) * pair.elapsed_s
        return np.vstack([rest, remembered_m, spread_m[best]])

    def _last_velocities(self, box: Boxes, current: Sweep) -> F64:
        """(0 or 1, 2) ego-axes velocity of the remembered object that would be here by now."""
        memory = self._memory
        if memory is None or len(memory.centre_m) == 0:
            return np.zeros((0, 2))
        here_m = current.world_T_ego.apply(box.centre_m)[0, :2]
        since_s = seconds_between(memory.stamp_ns, current.stamp_ns)
        expected_m = memory.centre_m + memory.velocity_mps * since_s
        distance_m = np.hypot(*(expected_m - here_m).T)
        nearest = int(np.argmin(distance_m))
        if distance_m[nearest] > float(box.size_m[0, :2].max()) / 2:
            return np.zeros((0, 2))
        return memory.velocity_mps[[nearest]] @ rotation_2d(current.world_T_ego.yaw_rad)

    def _align(self, cluster_m: F32, start_m: F64, pair: _Pair) -> F64:
        """Planar shift (2,) of the cluster's centroid under small-gicp's point-to-point ICP."""
        centre_m = cluster_m.mean(axis=0, dtype=np.float64)
        initial = np.eye(4)
        initial[:3, 3] = centre_m
        initial[:2, 3] += start_m
        result = small_gicp.align(
            pair.target,
            small_gicp.PointCloud(cluster_m - centre_m),
            pair.tree,
            initial,
            registration_type="ICP",
            max_correspondence_distance=2 * self.config.gate_m,
        )
        shift_m: F64 = (result.T_target_source[:3, 3] - centre_m)[:2]
        return shift_m

    def _remember(self, boxes: Boxes, velocity_mps: F64, current: Sweep) -> None:
        """Keeps the measured objects, in the world, for the starts of the next pair."""
        known = np.isfinite(velocity_mps).all(axis=1)
        world_T_ego = current.world_T_ego
        self._memory = _Memory(
            world_T_ego.apply(boxes.centre_m)[known, :2],
            velocity_mps[known] @ rotation_2d(world_T_ego.yaw_rad).T,
            current.stamp_ns,
        )

    def _field(
        self,
        kept: Sweep,
        box_of: I64,
        velocity_mps: F64,
        elapsed_s: float,
    ) -> FlowField:
        rows, cols, in_grid = self.grid.cells(kept.xyz_m)
        measured = np.append(np.isfinite(velocity_mps).all(axis=1), False)[box_of]
        chosen = in_grid & measured
        field_mps = np.zeros((*self.grid.shape, 2), dtype=np.float32)
        valid = np.zeros(self.grid.shape, dtype=np.bool_)
        field_mps[rows[chosen], cols[chosen]] = velocity_mps[box_of[chosen]]
        valid[rows[chosen], cols[chosen]] = True
        occupied = self.grid.occupancy(kept.xyz_m)
        # both sweeps sample the surface anew, so the error of a shift is that of two positions
        variance = np.where(valid, 2 * (self.config.sigma_m / elapsed_s) ** 2, 0.0).astype(
            np.float32
        )
        return FlowField(
            grid=self.grid,
            velocity_mps=field_mps,
            covariance_m2ps2=variance[..., None, None] * np.eye(2, dtype=np.float32),
            occupied=occupied,
            valid=valid,
            weight=occupied.astype(np.float32),
            stamp_ns=kept.stamp_ns,
        )


def _prepared(previous_m: F32, elapsed_s: float, gate_m: float) -> _Pair:
    target = small_gicp.PointCloud(previous_m.astype(np.float64))
    # starts are compared on thinned points, the same for all; ICP itself has every point
    thinned_m = previous_m[first_in_voxel(previous_m, _VOXEL_M)]
    reach_m = float(np.abs(previous_m[:, :2]).max()) + gate_m
    grid = build_point_grid(thinned_m, gate_m / 2, reach_m)
    return _Pair(target, small_gicp.KdTree(target), grid, elapsed_s)


def _spread(yaw_rad: float, reach_m: float) -> F64:
    """(K, 2) shifts along and a little across the heading, 0.4 m apart: within ICP's reach."""
    along_m = np.arange(-np.floor(reach_m / 0.4), np.floor(reach_m / 0.4) + 1) * 0.4
    across_m = np.array([-0.4, 0.0, 0.4])
    grid_m = np.stack(np.meshgrid(along_m, across_m, indexing="ij"), axis=-1).reshape(-1, 2)
    return grid_m @ rotation_2d(yaw_rad).T


def _reach(box: Boxes) -> float:
    """Half width of a square around the centroid that holds every point of the box."""
    return float(np.hypot(*box.size_m[0, :2])) + 1.0


def _moved_box(box: Boxes, shift_m: F64, margin_m: float) -> F64:
    """(8,) centre, half sizes, cosine and sine of the heading of the shifted box."""
    half_m = box.size_m[0] / 2 + margin_m
    yaw_rad = box.yaw_rad[0]
    centre_m = box.centre_m[0] + np.append(shift_m, 0.0)
    return np.concatenate([centre_m, half_m, [np.cos(yaw_rad), np.sin(yaw_rad)]])

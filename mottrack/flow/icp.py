"""ICP + Det.: the paper's learning-free baseline (section IV-C).

"We select the 3-D points within the clusters, and then apply ICP to obtain the transform between
the two point clouds." The points of each detection box are registered to the previous sweep with
small-gicp. One start is the paper's form. Several starts, compared by their residuals in both
directions, are the fair one: ICP only finds the nearest minimum, and a car at 15 m/s is 1.5 m away
from its last place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

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
from mottrack.flow.registration.boxes import BoxLimits, BoxMatcher, displacements_m
from mottrack.flow.shipped_errors import shipped_errors
from mottrack.flow.stages import Stages, StagesConfig, VisibilityStage
from mottrack.flow.sweep_pair import (
    GroundStage,
    SweepPair,
    elapsed_seconds,
    flow_field,
    is_measurable,
    obstacle_points,
    unmeasured,
)
from mottrack.lidar.in_boxes import points_in_boxes
from mottrack.lidar.point_grid import PointGrid, build_point_grid, first_in_voxel
from mottrack.lidar.residual import box_residual, truncated_residual, truncated_residuals

_VOXEL_M = 0.1
"""Starts are compared on thinned points, the same for all; ICP itself has every point."""
_START_STEP_M = 0.4
"""Distance of the starts along and across the heading: within ICP's basin of attraction."""
_FEWEST_POINTS = 6
"""Thinned points of a box that is searched everywhere: fewer have no shape."""
_FASTEST_TURN_RADPS = 0.5
"""Rotation of a vehicle on a street; that of an outline that changes is faster."""


class IcpConfig(StrictModel):
    """How objects are registered."""

    ground: GroundStage = Field(default_factory=GroundStage)
    starts: int = Field(6, ge=1, description="starts per object; 1: from rest only, as the paper")
    search: Literal["along_heading", "everywhere"] = Field(
        "along_heading",
        description="everywhere: starts from an occupancy correlation, compared in both directions "
        "and refined by a pattern search (slower; `starts` is not used)",
    )
    use_truth: bool = Field(False, description="boxes of the truth in place of detections")
    margin_m: float = Field(0.15, ge=0, description="boxes grow by this on each side")
    min_points: int = Field(11, ge=11, description="small-gicp registers no smaller clusters")
    max_points: int = Field(400, ge=11, description="larger clusters are thinned evenly")
    advantage_m: float = Field(
        0.02, ge=0, description="least gain in residual of a far start over the start from rest"
    )
    min_score: float = Field(0.0, description="boxes below this score are not registered")
    max_speed_mps: float = Field(40.0, gt=0, description="fastest start and fastest result")
    truncation_m: float = Field(
        0.5, gt=0, description="truncation distance of the residual; half of ICP's farthest pair"
    )
    worst_residual_m: float = Field(0.3, gt=0, description="a worse match is not a measurement")
    sigma_m: float = Field(0.03, gt=0, description="noise of one coordinate of a registration")


@dataclass(frozen=True, slots=True)
class _Target:
    """The previous sweep, indexed for registration."""

    points: small_gicp.PointCloud
    tree: small_gicp.KdTree
    grid: PointGrid
    """Thinned points."""
    elapsed_s: float


@dataclass(frozen=True, slots=True)
class _Measured:
    """Objects of the last pair that were measured, in the world frame."""

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
        self._last: _Measured | None = None
        # for the search everywhere alone: what each sweep could see, and aligned sweeps
        visible = StagesConfig(ground=self._ground, visibility=VisibilityStage(enabled=False))
        self._stages = Stages(visible, self.grid)

    def observe(self, frame: Frame) -> None:
        """Store the boxes of a frame: detections, or truth where the configuration says so."""
        found = frame.detections
        if self.config.use_truth:
            self._boxes = frame.truth
        elif found is not None:
            self._boxes = found.select(found.score >= self.config.min_score)
        else:
            self._boxes = None

    def reset(self) -> None:
        """Remove boxes and velocities at the start of a scene."""
        self._boxes, self._last = None, None
        self._stages.reset()

    def estimate(self, past: Sequence[Sweep], current: Sweep) -> FlowField:
        """Return the field of the boxes observed last; cells outside every box are not valid.

        No cell is where the pose jumped or `LONGEST_SEARCH_S` lie between the two sweeps.

        Raises:
            InputError: the sweeps are not in order of time.
        """
        elapsed_s, previous = elapsed_seconds(past, current), past[-1]
        obstacles, _ = obstacle_points(current, self._ground)
        boxes, measurable = self._boxes, is_measurable(previous, current)
        stale = boxes is None or boxes.stamp_ns != current.stamp_ns
        if boxes is None or stale or not measurable or not len(obstacles):
            return unmeasured(self.grid, obstacles)
        previous_m = self._reachable_m(previous, current)
        if len(previous_m) < self.config.min_points:
            return unmeasured(self.grid, obstacles)
        boxes = boxes.transformed(current.world_T_ego.inverse(), "ego")
        if self.config.search == "everywhere":
            return self._searched_everywhere(self._stages.before(past[-1:], current), boxes)
        target = _index(previous_m, elapsed_s, self.config.truncation_m)
        inside = points_in_boxes(
            obstacles.xyz_m, boxes.centre_m, boxes.size_m, boxes.yaw_rad, self.config.margin_m
        )
        shifts_m = np.full((len(boxes), 2), np.nan)
        for b in range(len(boxes)):
            points_m = obstacles.xyz_m[inside.of(b)]
            thinned_m = points_m[:: max(len(points_m) // self.config.max_points, 1)]
            if len(points_m) >= self.config.min_points:
                box = boxes.select(np.array([b]))
                shifts_m[b] = self._register(np.array(thinned_m), box, target, current)
        velocity_mps = -shifts_m / elapsed_s
        self._store(boxes, velocity_mps, current)
        return self._field(obstacles, inside.first_box(len(obstacles)), velocity_mps, elapsed_s)

    def _searched_everywhere(self, pair: SweepPair, boxes: Boxes) -> FlowField:
        """Return the field of the boxes, each registered from wherever it can have come."""
        limits = BoxLimits(
            self.config.margin_m,
            _FEWEST_POINTS,
            self.config.max_speed_mps * pair.elapsed_s,
            _FASTEST_TURN_RADPS * pair.elapsed_s,
        )
        expected_m = [
            -self._last_velocity(boxes.select(np.array([b])), pair.current) * pair.elapsed_s
            for b in range(len(boxes))
        ]
        found = BoxMatcher(pair, limits).match(boxes, expected_m)
        box_mps = np.full((len(boxes), 2), np.nan)
        cell_mps = np.zeros((*self.grid.shape, 2))
        valid = np.zeros(self.grid.shape, dtype=np.bool_)
        for b, motion in enumerate(found.motion):
            if motion is not None:
                rows, cols, in_grid = self.grid.cells(pair.current.xyz_m[found.inside == b])
                rows, cols = rows[in_grid], cols[in_grid]
                places_m = self.grid.centres_m()[rows, cols]
                cell_mps[rows, cols] = displacements_m(motion, places_m) / pair.elapsed_s
                valid[rows, cols] = True
                box_mps[b] = displacements_m(motion, boxes.centre_m[[b], :2])[0] / pair.elapsed_s
        self._store(boxes, box_mps, pair.current)
        variance = 2 * (self.config.sigma_m / pair.elapsed_s) ** 2
        return flow_field(self.grid, pair.current, cell_mps, valid, variance)

    def _reachable_m(self, previous: Sweep, current: Sweep) -> F32:
        """Return the previous obstacle points (N, 3) in the current frame.

        Those twice as far as points are kept, as after a long gap, are compared with nothing:
        without them the memory of an index does not grow with the gap.
        """
        then, _ = obstacle_points(previous, self._ground)
        xyz_m = then.seen_from(current).xyz_m
        reach_m = 2.0 * self._ground.find.reach_m
        far = np.abs(xyz_m[:, :2]).max(axis=1, initial=0.0) > reach_m
        return xyz_m[~far] if far.any() else xyz_m

    def _register(self, cluster_m: F32, box: Boxes, target: _Target, current: Sweep) -> F64:
        """Return the planar shift (2,) of a cluster to where it was; NaN if that is uncertain."""
        config = self.config
        centre_m = cluster_m.mean(axis=0)
        # half width: every point of the box lies within its diagonal of the centroid, and within
        # the square of obstacle points, whatever size a detector gives it
        widest_m = 2.0 * self._ground.find.reach_m
        half_m = min(float(np.hypot(*box.size_m[0, :2])), widest_m) + 1.0
        own_grid = build_point_grid(cluster_m - centre_m, config.truncation_m, half_m)
        best_m, best_residual_m = np.full(2, np.nan), config.worst_residual_m
        for k, start_m in enumerate(self._starts(cluster_m, box, target, current)):
            shift_m = self._align(cluster_m, start_m, target)
            if not np.hypot(*shift_m) <= config.max_speed_mps * target.elapsed_s:
                continue
            x_m, y_m = shift_m.tolist()
            forward_m = truncated_residual(target.grid, cluster_m, (x_m, y_m), config.truncation_m)
            moved = _moved_box(box, shift_m, config.margin_m)
            offset_m = np.array([x_m + centre_m[0], y_m + centre_m[1], centre_m[2]], np.float64)
            backward_m = box_residual(target.grid, own_grid, moved, offset_m, config.truncation_m)
            residual_m = 0.5 * (forward_m + backward_m) - (config.advantage_m if k == 0 else 0)
            if residual_m < best_residual_m:
                best_m, best_residual_m = shift_m, residual_m
        return best_m

    def _starts(self, cluster_m: F32, box: Boxes, target: _Target, current: Sweep) -> F64:
        """Return (K, 2) planar shifts: rest, by the last velocity, and the best of a spread."""
        rest_m = np.zeros((1, 2))
        if self.config.starts == 1:
            return rest_m
        reach_m = self.config.max_speed_mps * target.elapsed_s
        spread_m = _spread(float(box.yaw_rad[0]), reach_m)
        residual_m = truncated_residuals(target.grid, cluster_m, spread_m, self.config.truncation_m)
        best = np.argsort(residual_m, kind="stable")[: self.config.starts - 1]
        predicted_m = -self._last_velocity(box, current) * target.elapsed_s
        return np.vstack([rest_m, predicted_m, spread_m[best]])

    def _last_velocity(self, box: Boxes, current: Sweep) -> F64:
        """Return (0 or 1, 2) the velocity, in ego axes, of the last object that would be here."""
        last = self._last
        if last is None or len(last.centre_m) == 0:
            return np.zeros((0, 2))
        here_m = current.world_T_ego.apply(box.centre_m)[0, :2]
        since_s = seconds_between(last.stamp_ns, current.stamp_ns)
        expected_m = last.centre_m + last.velocity_mps * since_s
        distance_m = np.hypot(*(expected_m - here_m).T)
        nearest = int(np.argmin(distance_m))
        if distance_m[nearest] > float(box.size_m[0, :2].max()) / 2:
            return np.zeros((0, 2))
        return last.velocity_mps[[nearest]] @ rotation_2d(current.world_T_ego.yaw_rad)

    def _align(self, cluster_m: F32, start_m: F64, target: _Target) -> F64:
        """Return the planar shift (2,) of the centroid by small-gicp's point-to-point ICP."""
        centre_m = cluster_m.mean(axis=0, dtype=np.float64)
        initial = np.eye(4)
        initial[:3, 3] = centre_m
        initial[:2, 3] += start_m
        result = small_gicp.align(
            target.points,
            small_gicp.PointCloud(cluster_m - centre_m),
            target.tree,
            initial,
            registration_type="ICP",
            max_correspondence_distance=2 * self.config.truncation_m,
        )
        shift_m: F64 = (result.T_target_source[:3, 3] - centre_m)[:2]
        return shift_m

    def _store(self, boxes: Boxes, velocity_mps: F64, current: Sweep) -> None:
        """Store the measured objects, in the world frame, for the starts of the next pair."""
        known = np.isfinite(velocity_mps).all(axis=1)
        world_T_ego = current.world_T_ego
        self._last = _Measured(
            world_T_ego.apply(boxes.centre_m)[known, :2],
            velocity_mps[known] @ rotation_2d(world_T_ego.yaw_rad).T,
            current.stamp_ns,
        )

    def _field(
        self, obstacles: Sweep, box_of: I64, velocity_mps: F64, elapsed_s: float
    ) -> FlowField:
        rows, cols, in_grid = self.grid.cells(obstacles.xyz_m)
        # the last entry is picked by -1: points outside every box
        measured = np.append(np.isfinite(velocity_mps).all(axis=1), False)[box_of]
        chosen = in_grid & measured
        cell_mps = np.zeros((*self.grid.shape, 2))
        valid = np.zeros(self.grid.shape, dtype=np.bool_)
        cell_mps[rows[chosen], cols[chosen]] = velocity_mps[box_of[chosen]]
        valid[rows[chosen], cols[chosen]] = True
        # both sweeps sample the surface anew, so the error of a shift is that of two positions
        variance = 2 * (self.config.sigma_m / elapsed_s) ** 2
        return flow_field(self.grid, obstacles, cell_mps, valid, variance)


def _index(previous_m: F32, elapsed_s: float, truncation_m: float) -> _Target:
    points = small_gicp.PointCloud(previous_m.astype(np.float64))
    thinned_m = previous_m[first_in_voxel(previous_m, _VOXEL_M)]
    half_m = float(np.abs(previous_m[:, :2]).max()) + truncation_m
    grid = build_point_grid(thinned_m, truncation_m / 2, half_m)
    return _Target(points, small_gicp.KdTree(points), grid, elapsed_s)


def _spread(yaw_rad: float, reach_m: float) -> F64:
    """Return (K, 2) shifts along the heading, and at most one step across it."""
    steps = np.floor(reach_m / _START_STEP_M)
    along_m = np.arange(-steps, steps + 1) * _START_STEP_M
    across_m = np.array([-_START_STEP_M, 0.0, _START_STEP_M])
    shifts_m = np.stack(np.meshgrid(along_m, across_m, indexing="ij"), axis=-1).reshape(-1, 2)
    return shifts_m @ rotation_2d(yaw_rad).T


def _moved_box(box: Boxes, shift_m: F64, margin_m: float) -> F64:
    """Return (8,) centre, half sizes, cosine and sine of the heading of the shifted box."""
    half_m = box.size_m[0] / 2 + margin_m
    yaw_rad = box.yaw_rad[0]
    centre_m = box.centre_m[0] + np.append(shift_m, 0.0)
    return np.concatenate([centre_m, half_m, [np.cos(yaw_rad), np.sin(yaw_rad)]])

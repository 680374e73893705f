"""Real LiDAR with known flow: consecutive sweeps and the true velocity of each occupied cell.

PandaSet-002 is in the Argoverse 2 sensor layout, KITTI 0000 in packed sweeps; both are read from
the shared data folder and are no part of the project.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.feather
from numpy.typing import NDArray

from mottrack.core.frame import Frame
from mottrack.core.grid import BevGrid
from mottrack.core.objects import Truth
from mottrack.core.pose import Pose
from mottrack.core.sweep import Sweep, seconds_between
from mottrack.flow.sweep_pair import GroundStage, obstacle_points
from mottrack.lidar.in_boxes import points_in_boxes

MARGIN_M = 0.15
STATIC_BELOW_MPS = 0.4
HALF_WINDOW = 4
KITTI_VIEW_RAD = np.radians(38.0)
PANDAR_ORIGIN_M = np.array([1.5, 0.0, 1.95])
"""Where the beams of this recording meet, from the sharpness of their elevations."""


@dataclass(frozen=True)
class Drive:
    """A recorded drive with truth at every sweep."""

    name: str
    sweeps: list[Sweep]
    truth: list[Truth]
    """World frame, one for each sweep."""
    view_rad: float
    """Objects are annotated within this angle of straight ahead."""

    def frame(self, index: int) -> Frame:
        """The frame that a flow source observes."""
        sweep = self.sweeps[index]
        return Frame(sweep.stamp_ns, sweep.world_T_ego, truth=self.truth[index])


@dataclass(frozen=True)
class CellTruth:
    """Truth on the occupied cells of one sweep."""

    rows: NDArray[np.int64]
    cols: NDArray[np.int64]
    velocity_mps: NDArray[np.float64]
    """(C, 2) over the ground, current ego axes."""
    object_of: NDArray[np.int64]
    """(C,) row of the object in the sweep's truth, -1 for background."""


def cell_truth(drive: Drive, index: int, grid: BevGrid) -> CellTruth:
    """Rigid motion of the grown boxes since the sweep before, on cells that hold their points.

    A cell belongs to an object if most of its points do; the velocity is that of the mean of
    those points, turn included. Objects whose mean speed over nine frames is under 0.4 m/s rest.
    """
    sweep, truth = drive.sweeps[index], drive.truth[index]
    kept, _ = obstacle_points(sweep, GroundStage())
    xyz_m = kept.xyz_m.astype(np.float64)
    xyz_m = xyz_m[np.abs(np.arctan2(xyz_m[:, 1], xyz_m[:, 0])) <= drive.view_rad]
    ego = truth.transformed(sweep.world_T_ego.inverse(), "ego")
    inside = points_in_boxes(xyz_m, ego.centre_m, ego.size_m, ego.yaw_rad, MARGIN_M)
    object_of = inside.first_box(len(xyz_m))
    velocity_mps, known = _point_velocities(drive, index, xyz_m, object_of)
    rows, cols, in_grid = grid.cells(xyz_m)
    flat = rows * grid.shape[1] + cols
    usable = in_grid & known
    cells, cell_of = np.unique(flat[usable], return_inverse=True)
    on_object = object_of[usable] >= 0
    total = np.bincount(cell_of, minlength=len(cells))
    hits = np.bincount(cell_of, on_object, minlength=len(cells))
    majority = hits * 2 > total
    sums = np.stack(
        [np.bincount(cell_of, velocity_mps[usable, k] * on_object, len(cells)) for k in (0, 1)], -1
    )
    mean_mps = np.where(majority[:, None], sums / np.maximum(hits, 1)[:, None], 0.0)
    owner = np.full(len(cells), -1, np.int64)
    owner[cell_of[on_object]] = object_of[usable][on_object]
    return CellTruth(
        cells // grid.shape[1], cells % grid.shape[1], mean_mps, np.where(majority, owner, -1)
    )


def _point_velocities(
    drive: Drive, index: int, xyz_m: NDArray[np.float64], object_of: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Velocity of each point by its box's rigid motion, and whether it is known."""
    sweep, truth, before = drive.sweeps[index], drive.truth[index], drive.truth[index - 1]
    elapsed_s = seconds_between(before.stamp_ns, truth.stamp_ns)
    rotation = sweep.world_T_ego.inverse().rotation
    velocity_mps = np.zeros((len(xyz_m), 2))
    known = np.ones(len(xyz_m), dtype=np.bool_)
    world_m = sweep.world_T_ego.apply(xyz_m)
    for b in range(len(truth)):
        on_b = object_of == b
        then = np.flatnonzero(before.id == truth.id[b])
        if not on_b.any() or _mean_speed(drive, index, int(truth.id[b])) < STATIC_BELOW_MPS:
            continue
        if len(then) == 0:
            known[on_b] = False
            continue
        world_T_now = Pose.from_yaw(truth.yaw_rad[b], truth.centre_m[b])
        world_T_then = Pose.from_yaw(before.yaw_rad[then[0]], before.centre_m[then[0]])
        moved_m = world_m[on_b] - (world_T_then @ world_T_now.inverse()).apply(world_m[on_b])
        velocity_mps[on_b] = (moved_m @ rotation.T)[:, :2] / elapsed_s
    return velocity_mps, known


def _mean_speed(drive: Drive, index: int, identity: int) -> float:
    """Speed between the first and the last sighting within four frames either way."""
    seen = [
        (truth.stamp_ns, truth.centre_m[truth.id == identity][0])
        for truth in drive.truth[max(index - HALF_WINDOW, 0) : index + HALF_WINDOW + 1]
        if (truth.id == identity).any()
    ]
    if len(seen) < 2:
        return 0.0
    (first_ns, first_m), (last_ns, last_m) = seen[0], seen[-1]
    return float(np.hypot(*(last_m - first_m)[:2]) / seconds_between(first_ns, last_ns))


def read_pandaset(folder: Path) -> Drive:
    """The PandaSet drive in the Argoverse 2 layout under `folder`."""
    poses = pyarrow.feather.read_table(folder / "city_SE3_egovehicle.feather").to_pydict()
    pose_of = {
        stamp: Pose.from_quaternion_wxyz(q, t)
        for stamp, q, t in zip(
            poses["timestamp_ns"],
            zip(*(poses[k] for k in ("qw", "qx", "qy", "qz")), strict=True),
            zip(*(poses[k] for k in ("tx_m", "ty_m", "tz_m")), strict=True),
            strict=True,
        )
    }
    boxes = pyarrow.feather.read_table(folder / "annotations.feather")
    columns = {name: boxes[name].to_numpy() for name in boxes.column_names}
    ids = np.unique(columns["track_uuid"], return_inverse=True)[1]
    sweeps, truths = [], []
    for path in sorted((folder / "sensors" / "lidar").glob("*.feather")):
        stamp_ns = int(path.stem)
        table = pyarrow.feather.read_table(path)
        xyz_m = np.column_stack([table[k].to_numpy() for k in "xyz"]).astype(np.float32)
        reflectance = table["intensity"].to_numpy().astype(np.float32) / 255
        sweeps.append(Sweep(xyz_m, reflectance, stamp_ns, pose_of[stamp_ns], PANDAR_ORIGIN_M))
        at = columns["timestamp_ns"] == stamp_ns
        local = _truth(
            stamp_ns,
            np.column_stack([columns[k][at] for k in ("tx_m", "ty_m", "tz_m")]),
            np.column_stack([columns[k][at] for k in ("length_m", "width_m", "height_m")]),
            2 * np.arctan2(columns["qz"][at], columns["qw"][at]),
            ids[at],
        )
        truths.append(local.transformed(pose_of[stamp_ns], "world"))
    return Drive("PandaSet-002", sweeps, truths, np.pi)


def read_kitti(folder: Path, sequence: str = "0000") -> Drive:
    """A KITTI tracking sequence with packed sweeps; the ego frame is the Velodyne's."""
    training = folder / "training"
    calibration = {
        line.split()[0].rstrip(":"): np.array(line.split()[1:], dtype=np.float64)
        for line in (training / "calib" / f"{sequence}.txt").read_text().splitlines()
        if line.strip()
    }
    rectify = np.eye(4)
    rectify[:3, :3] = calibration["R0_rect"].reshape(3, 3)
    camera_T_velo = np.vstack([calibration["Tr_velo_to_cam"].reshape(3, 4), [0, 0, 0, 1]])
    cam_T_ego = _rigid(rectify @ camera_T_velo)
    world_T_cam = np.loadtxt(training / "poses" / f"{sequence}.txt").reshape(-1, 3, 4)
    ego0_T_world = cam_T_ego.inverse()
    labels = [
        line.split()
        for line in (training / "label_02" / f"{sequence}.txt").read_text().splitlines()
        if line.split()[1] != "-1"
    ]
    sweeps, truths = [], []
    for path in sorted((folder / "velodyne_packed" / sequence).glob("*.npz")):
        index = int(path.stem)
        stamp_ns = index * 100_000_000
        with np.load(path) as packed:
            xyz_m = packed["xyz_5mm"] * np.float32(0.005)
            reflectance = packed["reflectance_pct"] * np.float32(0.01)
        world_T_ego = ego0_T_world @ _rigid(world_T_cam[index]) @ cam_T_ego
        sweeps.append(Sweep(xyz_m, np.clip(reflectance, 0, 1), stamp_ns, world_T_ego))
        rows = np.array([r for r in labels if int(r[0]) == index], dtype=object)
        truths.append(_kitti_truth(rows, stamp_ns, cam_T_ego).transformed(world_T_ego, "world"))
    return Drive("KITTI 0000", sweeps, truths, KITTI_VIEW_RAD)


def _kitti_truth(rows: NDArray[np.object_], stamp_ns: int, cam_T_ego: Pose) -> Truth:
    """Boxes of the camera frame (bottom centre, h w l, turn about the camera's y) in the ego's."""
    if len(rows) == 0:
        return Truth.empty(stamp_ns, "ego")
    values = rows[:, 10:17].astype(np.float64)
    ego_T_cam = cam_T_ego.inverse()
    centre_cam_m = values[:, 3:6] - np.array([0.0, 0.5, 0.0]) * values[:, :1]
    heading_cam = np.column_stack([np.cos(values[:, 6]), 0 * values[:, 6], -np.sin(values[:, 6])])
    heading = heading_cam @ ego_T_cam.rotation.T
    return _truth(
        stamp_ns,
        ego_T_cam.apply(centre_cam_m),
        values[:, [2, 1, 0]],
        np.arctan2(heading[:, 1], heading[:, 0]),
        rows[:, 1].astype(np.int64),
    )


def _rigid(matrix: NDArray[np.float64]) -> Pose:
    """The rigid transform nearest to a (3|4, 4) matrix printed with few digits."""
    u, _, vt = np.linalg.svd(matrix[:3, :3])
    return Pose(u @ vt, matrix[:3, 3])


def _truth(
    stamp_ns: int,
    centre_m: NDArray[np.float64],
    size_m: NDArray[np.float64],
    yaw_rad: NDArray[np.float64],
    identity: NDArray[np.int64],
) -> Truth:
    n = len(identity)
    return Truth(
        stamp_ns=stamp_ns,
        frame="ego",
        centre_m=centre_m,
        size_m=size_m,
        yaw_rad=yaw_rad,
        label=np.full(n, "object"),
        id=identity,
        velocity_mps=np.zeros((n, 2)),
        num_points=np.full(n, -1),
        interpolated=np.zeros(n, dtype=np.bool_),
    )

"""Real LiDAR with known flow: consecutive sweeps and the true velocity of each occupied cell.

PandaSet-002 is in the Argoverse 2 sensor layout, KITTI 0000 in packed sweeps; both lie in the
shared data folder and are no part of the project.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.frame import Frame
from mottrack.core.grid import BevGrid
from mottrack.core.objects import Truth
from mottrack.core.pose import Pose
from mottrack.core.sweep import Sweep, seconds_between
from mottrack.datasets.argoverse2.config import Argoverse2Config
from mottrack.datasets.argoverse2.dataset import Argoverse2
from mottrack.datasets.kitti.config import KittiConfig
from mottrack.datasets.kitti.dataset import Kitti
from mottrack.flow.sweep_pair import GroundStage, obstacle_points
from mottrack.lidar.in_boxes import points_in_boxes

MARGIN_M = 0.15
"""Annotated boxes are tight and a few centimetres off; their surface points lie within this."""
STATIC_BELOW_MPS = 0.4
"""A slower object is at rest: annotated centres jitter by some centimetres in half a second."""
HALF_WINDOW = 4
"""Frames on either side over which an object's mean speed is taken: 0.8 s at 10 Hz."""
KITTI_VIEW_RAD = np.radians(38.0)
"""KITTI annotates what its camera sees, about 40 degrees to either side."""
PANDAR_ORIGIN_M = (1.5, 0.0, 1.95)
"""Optical centre of this recording, estimated from the sharpness of its beams' elevations."""


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
        """Return the frame that a flow source observes."""
        sweep = self.sweeps[index]
        return Frame(sweep.stamp_ns, sweep.world_T_ego, truth=self.truth[index])


@dataclass(frozen=True)
class CellTruth:
    """Truth on the occupied cells of one sweep."""

    rows: I64
    cols: I64
    velocity_mps: F64
    """(C, 2) over the ground, current ego axes."""
    object_of: I64
    """(C,) row of the object in the sweep's truth, -1 for background."""


def cell_truth(drive: Drive, index: int, grid: BevGrid) -> CellTruth:
    """Return the rigid motion of the boxes since the sweep before, on cells that hold their points.

    A cell belongs to an object if most of its points do; the velocity is that of the mean of
    those points, rotation included. Objects slower than `STATIC_BELOW_MPS` rest.
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


def _point_velocities(drive: Drive, index: int, xyz_m: F64, object_of: I64) -> tuple[F64, Mask]:
    """Return each point's velocity by its box's rigid motion, and whether it is known."""
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
    """Return the speed between the first and the last sighting within `HALF_WINDOW`."""
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
    """Read the PandaSet drive in the Argoverse 2 layout at `folder`."""
    config = Argoverse2Config(
        root=folder.parents[1],
        split=folder.parent.name,
        scenes=(folder.name,),
        require_sweeps=True,
        lidar_origin_m=PANDAR_ORIGIN_M,
    )
    scene = Argoverse2(config).scene(folder.name)
    indices = range(len(scene))
    truth = [scene.frame(i).truth for i in indices]
    return Drive("PandaSet-002", [scene.sweep(i) for i in indices], truth, np.pi)


def read_kitti(folder: Path, sequence: str = "0000") -> Drive:
    """Read a KITTI tracking sequence with packed sweeps."""
    config = KittiConfig(root=folder, scenes=(sequence,), poses="poses", detections=None)
    scene = Kitti(config).scene(sequence)
    sweeps, truth = [], []
    for path in sorted((folder / "velodyne_packed" / sequence).glob("*.npz")):
        frame = scene.frame(int(path.stem))
        with np.load(path) as packed:
            xyz_m = packed["xyz_5mm"] * np.float32(0.005)
            reflectance = np.clip(packed["reflectance_pct"] * np.float32(0.01), 0, 1)
        sweeps.append(Sweep(xyz_m, reflectance, frame.stamp_ns, frame.world_T_ego))
        truth.append(frame.truth)
    return Drive("KITTI 0000", sweeps, truth, KITTI_VIEW_RAD)

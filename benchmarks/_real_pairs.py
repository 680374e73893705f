"""Real LiDAR with known flow: consecutive sweeps and the true velocity of each occupied cell.

PandaSet 002 and 002b are in the Argoverse 2 sensor layout, KITTI 0000 in packed sweeps; all lie in
the shared data folder and are no part of the project.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mottrack.core.arrays import F64, I64, Mask, Texts
from mottrack.core.frame import Frame
from mottrack.core.grid import BevGrid
from mottrack.core.motion import MOVING_MPS
from mottrack.core.objects import Truth
from mottrack.core.sweep import Sweep, seconds_between
from mottrack.datasets.argoverse2.config import Argoverse2Config
from mottrack.datasets.argoverse2.dataset import Argoverse2
from mottrack.datasets.fitted_velocity import fitted_slopes
from mottrack.datasets.kitti.config import KittiConfig
from mottrack.datasets.kitti.dataset import Kitti
from mottrack.flow.ground_truth import RIM_M
from mottrack.flow.sweep_pair import GroundStage, obstacle_points
from mottrack.lidar.in_boxes import near_boxes, points_in_boxes

MARGIN_M = 0.15
"""Annotated boxes are tight and a few centimetres off; their surface points lie within this."""
STATIC_BELOW_MPS = 0.4
"""A slower object is at rest: velocities fitted to KITTI's parked cars reach 0.3 m/s."""
KITTI_VIEW_RAD = np.radians(38.0)
"""KITTI annotates what its camera sees, about 40 degrees to either side."""
PANDAR_ORIGIN_M = (1.5, 0.0, 1.95)
"""Optical centre of this recording, estimated from the sharpness of its beams' elevations."""
MAX_TURN_RADPS = 1.0
"""No vehicle turns faster; a faster box has its heading turned by a mistake."""
EGO_RESTS_BELOW_MPS = 0.5
"""Of the vehicle: as for objects."""
STEP_S = 0.1
"""Time between the sweeps of these drives, in which a cell enters the grid."""


@dataclass(frozen=True)
class Drive:
    """A recorded drive with truth at every sweep."""

    name: str
    sweeps: list[Sweep]
    truth: list[Truth]
    """World frame, one for each sweep; velocities are fitted over time by the data set."""
    view_rad: float
    """Objects are annotated within this angle of straight ahead."""
    turn_radps: list[F64]
    """Rate of rotation of each object, fitted likewise."""

    @classmethod
    def of(cls, name: str, sweeps: list[Sweep], truth: list[Truth], view_rad: float) -> Drive:
        """Fit the rates of rotation and make the drive."""
        return cls(name, sweeps, truth, view_rad, list(_turn_rates(truth)))

    def frame(self, index: int) -> Frame:
        """Return the frame that a flow source observes."""
        sweep = self.sweeps[index]
        return Frame(sweep.stamp_ns, sweep.world_T_ego, truth=self.truth[index])

    def ego_speed_mps(self, index: int) -> float:
        """Return the speed of the vehicle since the sweep before."""
        before, now = self.sweeps[index - 1], self.sweeps[index]
        moved_m = now.world_T_ego.translation_m - before.world_T_ego.translation_m
        return float(np.hypot(*moved_m[:2]) / seconds_between(before.stamp_ns, now.stamp_ns))


@dataclass(frozen=True)
class CellTruth:
    """Truth on the C occupied cells of one sweep."""

    rows: I64
    cols: I64
    velocity_mps: F64
    """(C, 2) over the ground, current ego axes."""
    label: Texts
    """(C,) class of the object, "" for background."""
    track: I64
    """(C,) its identity, -1 for background."""
    points: I64
    """(C,) obstacle points on it."""
    rim: Mask
    """(C,) static cells within `RIM_M` of a moving box: no figure counts them."""
    entering: Mask
    """(C,) moving cells that were outside the grid at the sweep before."""


def cell_truth(drive: Drive, index: int, grid: BevGrid) -> CellTruth:
    """Return the rigid motion of the boxes on the cells that hold their points.

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
    moving = np.hypot(*ego.velocity_mps.T) >= STATIC_BELOW_MPS  # not a number: not moving
    velocity_mps, known = _point_velocities(ego, moving, drive.turn_radps[index], xyz_m, object_of)
    rows, cols, in_grid = grid.cells(xyz_m)
    usable = in_grid & known
    cells, cell_of = np.unique((rows * grid.shape[1] + cols)[usable], return_inverse=True)
    on_object = object_of[usable] >= 0
    hits = np.bincount(cell_of, on_object, len(cells))
    majority = hits * 2 > np.bincount(cell_of, minlength=len(cells))
    sums = [np.bincount(cell_of, velocity_mps[usable, k] * on_object, len(cells)) for k in (0, 1)]
    mean_mps = np.where(majority[:, None], np.stack(sums, -1) / np.maximum(hits, 1)[:, None], 0.0)
    owner = np.full(len(cells), -1, np.int64)
    owner[cell_of[on_object]] = object_of[usable][on_object]
    owner = np.where(majority, owner, -1)
    centre_m = grid.centres_m().reshape(-1, 2)[cells]
    fast = np.hypot(*mean_mps.T) > MOVING_MPS
    points = np.bincount(object_of[object_of >= 0], minlength=len(truth))
    return CellTruth(
        rows=cells // grid.shape[1],
        cols=cells % grid.shape[1],
        velocity_mps=mean_mps,
        label=np.append(truth.label, "")[owner],
        track=np.append(truth.id, -1)[owner],
        points=np.append(points, 0)[owner],
        rim=~fast & near_boxes(centre_m, ego.select(moving), RIM_M),
        entering=fast & ~grid.cells(centre_m - STEP_S * mean_mps).inside,
    )


def _point_velocities(
    ego: Truth, moving: Mask, turn_radps: F64, xyz_m: F64, object_of: I64
) -> tuple[F64, Mask]:
    """Return each point's velocity by its box's rigid motion, and whether it is known."""
    known = np.append(np.isfinite(ego.velocity_mps).all(axis=1), True)[object_of]
    still = ~moving[:, None]
    linear_mps = np.vstack([np.where(still, 0.0, ego.velocity_mps), np.zeros(2)])[object_of]
    turn = np.append(np.where(moving, turn_radps, 0.0), 0.0)[object_of]
    arm_m = xyz_m[:, :2] - np.vstack([ego.centre_m[:, :2], np.zeros(2)])[object_of]
    return linear_mps + turn[:, None] * np.column_stack([-arm_m[:, 1], arm_m[:, 0]]), known


def _turn_rates(truth: list[Truth]) -> Iterator[F64]:
    identity = np.concatenate([one.id for one in truth])
    stamp_ns = np.concatenate([np.full(len(one), one.stamp_ns) for one in truth])
    yaw_rad = np.concatenate([one.yaw_rad for one in truth])
    for track in np.unique(identity):
        rows = np.flatnonzero(identity == track)
        rows = rows[np.argsort(stamp_ns[rows])]
        yaw_rad[rows] = np.unwrap(yaw_rad[rows])
    rates = np.nan_to_num(fitted_slopes(identity, stamp_ns, yaw_rad[:, None])[:, 0])
    rates = np.where(np.abs(rates) > MAX_TURN_RADPS, 0.0, rates)
    yield from np.split(rates, np.cumsum([len(one) for one in truth])[:-1])


def read_pandaset(folder: Path) -> Drive:
    """Read a PandaSet drive in the Argoverse 2 layout at `folder`."""
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
    name = folder.name.replace("pandaset-", "PandaSet ")
    return Drive.of(name, [scene.sweep(i) for i in indices], truth, np.pi)


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
    return Drive.of("KITTI 0000", sweeps, truth, KITTI_VIEW_RAD)

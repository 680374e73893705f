"""How the dialects of nuScenes are written: sensors, names of files, further fields."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mottrack.core import Frame, Pose, Sweep
from mottrack.core.arrays import F64
from mottrack.core.storage import write_bytes
from mottrack.datasets.nuscenes.dialect import NUSCENES, T4, TRUCKSCENES, Dialect
from mottrack.datasets.nuscenes.points import INTENSITY_MAX
from mottrack.datasets.nuscenes.static_rows import CATEGORIES, NUSCENES_LISTS, Lists, category_of
from mottrack.formats.nuscenes_records import CHANNEL
from mottrack.formats.pcd import write_pcd
from mottrack.formats.table_stream import Row

PITCH_RAD, ROLL_RAD = 0.02, -0.006
"""Tilt of the mounting, about that of nuScenes' calibrations."""
_EGO_R_LEVEL = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_PITCH = np.array(
    [
        [1.0, 0.0, 0.0],
        [0.0, np.cos(PITCH_RAD), -np.sin(PITCH_RAD)],
        [0.0, np.sin(PITCH_RAD), np.cos(PITCH_RAD)],
    ]
)
_ROLL = np.array(
    [
        [np.cos(ROLL_RAD), 0.0, np.sin(ROLL_RAD)],
        [0.0, 1.0, 0.0],
        [-np.sin(ROLL_RAD), 0.0, np.cos(ROLL_RAD)],
    ]
)
EGO_R_LIDAR = _EGO_R_LEVEL @ _PITCH @ _ROLL
"""nuScenes' LIDAR_TOP looks along its y axis, and stands a little askew."""


class Step(NamedTuple):
    """A frame, its sweep and, where there is one, the frame beside it, which tells the motion."""

    frame: Frame
    sweep: Sweep | None
    beside: Frame | None


class Part(NamedTuple):
    """What one LiDAR saw of a sweep.

    stamp_us: its own time. world_T_ego: pose of the vehicle at that time. ego_T_lidar: mounting.
    sweep: the points in the ego frame of that time; None where no points are written.
    """

    channel: str
    stamp_us: int
    world_T_ego: Pose
    ego_T_lidar: Pose
    sweep: Sweep | None


class FileName(NamedTuple):
    """What a file of points is named by."""

    scene: str
    channel: str
    number: int
    stamp_us: int
    is_key: bool


@dataclass(frozen=True)
class Style:
    """How a dialect is written.

    parts: what each LiDAR saw of a step, the main one first.
    write: writes the points of a part in the sensor's own frame.
    file: name of a file of points, under the root.
    fileformat: what sample_data says of it.
    category: label to category.
    lists: what its tables list.
    """

    dialect: Dialect
    parts: Callable[[Step], list[Part]]
    write: Callable[[Path, Part], None]
    file: Callable[[FileName], str]
    fileformat: str
    category: Callable[[str], str]
    lists: Lists

    def further(self, table: str) -> Row:
        """Return the fields of a table that nuScenes does not have."""
        return self.lists.further.get(table, {})


def microseconds(frame: Frame) -> int:
    """Return the time of a frame, rounded as the tables have it."""
    return round(frame.stamp_ns / 1000)


def _nuscenes_parts(step: Step) -> list[Part]:
    frame, sweep = step.frame, step.sweep
    origin_m = np.zeros(3) if sweep is None else sweep.origin_m
    mounting = Pose(EGO_R_LIDAR, origin_m)
    return [Part(CHANNEL, microseconds(frame), frame.world_T_ego, mounting, sweep)]


def _write_nuscenes(path: Path, part: Part) -> None:
    _write_rows(path, part, None)


def _write_rows(path: Path, part: Part, ring: float | None) -> None:
    """Write float32 x, y, z, intensity, ring; the same ring for all where one is given."""
    if part.sweep is None:
        return
    sweep = part.sweep
    xyz_m = part.ego_T_lidar.inverse().apply(sweep.xyz_m)
    rings = np.zeros(len(sweep)) if sweep.ring is None else sweep.ring
    if ring is not None:
        rings = np.full(len(sweep), ring)
    rows = np.column_stack([xyz_m, _intensity(sweep), rings])
    write_bytes(path, rows.astype("<f4").tobytes())


def _intensity(sweep: Sweep) -> F64:
    return np.round(sweep.reflectance.astype(np.float64) * INTENSITY_MAX)


def _nuscenes_file(name: FileName) -> str:
    folder = "samples" if name.is_key else "sweeps"
    file = f"{name.scene}__{name.channel}__{name.stamp_us}.pcd.bin"
    return f"{folder}/{name.channel}/{file}"


NUSCENES_STYLE = Style(
    NUSCENES,
    _nuscenes_parts,
    _write_nuscenes,
    _nuscenes_file,
    "pcd",
    category_of,
    NUSCENES_LISTS,
)


def _t4_parts(step: Step) -> list[Part]:
    """Return the one cloud of all LiDARs, which Autoware joins in `base_link`."""
    frame = step.frame
    stamp_us = microseconds(frame)
    return [Part(T4.channels.main[0], stamp_us, frame.world_T_ego, Pose.identity(), step.sweep)]


def _write_t4(path: Path, part: Part) -> None:
    _write_rows(path, part, -1.0)


def _t4_file(name: FileName) -> str:
    return f"data/{name.channel}/{name.number:05d}.pcd.bin"


def _t4_category(label: str) -> str:
    return label.rpartition(".")[2] or label


T4_CATEGORIES = (
    "car",
    "police_car",
    "fire_truck",
    "ambulance",
    "motorcycle",
    "trailer",
    "truck",
    "bicycle",
    "bus",
    "forklift",
    "pedestrian",
    "construction_worker",
    "personal_mobility",
    "police_officer",
    "stroller",
    "wheelchair",
    "animal",
)
"""The names that the T4 format allows (version 1.4)."""
T4_STYLE = Style(
    T4,
    _t4_parts,
    _write_t4,
    _t4_file,
    "pcd.bin",
    _t4_category,
    Lists(
        T4_CATEGORIES,
        {
            "1": ("none", "not visible"),
            "2": ("partial", "more than 10 % visible"),
            "3": ("most", "more than 50 % visible"),
            "4": ("full", "fully visible"),
        },
        T4.channels.main[:1],
        {
            "calibrated_sensor": {"camera_distortion": []},
            "instance": {"instance_name": ""},
            "sample_data": {"is_valid": True},
        },
        "data_captured",
    ),
)
"""Fields that every version of the format has: readers of older ones refuse further fields."""

APART_US = 2_000
"""Each LiDAR of the written truck turns so much behind the one before it."""
_MOUNT_M = np.array(
    [
        [1.6, 1.3, 2.6],
        [1.6, -1.3, 2.6],
        [1.7, 0.0, 3.2],
        [0.9, 1.2, 3.2],
        [0.9, -1.2, 3.2],
        [-6.0, 0.0, 1.0],
    ]
)
"""(6, 3) places of a truck's LiDARs: left, right, three on the roof, one at the back."""
_MOUNT_YAW_RAD = np.deg2rad([90.0, -90.0, 0.0, 135.0, -135.0, 180.0])
"""The way each of them looks."""


def _truck_parts(step: Step) -> list[Part]:
    """Share the points out among six LiDARs by their azimuth, each at a time of its own."""
    frame, sweep = step.frame, step.sweep
    found = []
    for number, channel in enumerate(TRUCKSCENES_CHANNELS):
        later_us = number * APART_US
        world_T_ego = _moved(step, later_us)
        mounting = Pose.from_yaw(float(_MOUNT_YAW_RAD[number]), _MOUNT_M[number])
        own = None
        if sweep is not None:
            azimuth = np.arctan2(sweep.xyz_m[:, 1], sweep.xyz_m[:, 0])
            sector = ((azimuth / (2.0 * np.pi)) % 1.0 * len(TRUCKSCENES_CHANNELS)).astype(int)
            # what stands is seen from where the vehicle is by then
            ego_T_frame = world_T_ego.inverse() @ frame.world_T_ego
            chosen = sweep.select(np.minimum(sector, len(TRUCKSCENES_CHANNELS) - 1) == number)
            xyz_m = ego_T_frame.apply(chosen.xyz_m).astype(np.float32)
            own = Sweep(xyz_m, chosen.reflectance, frame.stamp_ns, world_T_ego)
        found.append(Part(channel, microseconds(frame) + later_us, world_T_ego, mounting, own))
    return found


def _moved(step: Step, later_us: int) -> Pose:
    """Return the pose of the vehicle a little later, going on straight."""
    here = step.frame.world_T_ego
    if step.beside is None or not later_us:
        return here
    elapsed_ns = step.beside.stamp_ns - step.frame.stamp_ns
    way = step.beside.world_T_ego.translation_m - here.translation_m
    return Pose(here.rotation, here.translation_m + way * (later_us * 1000 / elapsed_ns))


def _write_truck(path: Path, part: Part) -> None:
    if part.sweep is None:
        return
    xyz_m = part.ego_T_lidar.inverse().apply(part.sweep.xyz_m)
    columns = {axis: xyz_m[:, i].astype(np.float32) for i, axis in enumerate("xyz")}
    columns["intensity"] = _intensity(part.sweep).astype(np.float32)
    stamps = np.full(len(xyz_m), part.stamp_us, dtype=np.uint64)
    write_pcd(path, {**columns, "timestamp": stamps})


def _truck_file(name: FileName) -> str:
    folder = "samples" if name.is_key else "sweeps"
    return f"{folder}/{name.channel}/{name.channel}_{name.scene}_{name.stamp_us}.pcd"


def _truck_category(label: str) -> str:
    return "vehicle.other" if label == "other_vehicle" else category_of(label)


TRUCKSCENES_CHANNELS = (*TRUCKSCENES.channels.main, *TRUCKSCENES.channels.further)
TRUCKSCENES_STYLE = Style(
    TRUCKSCENES,
    _truck_parts,
    _write_truck,
    _truck_file,
    "pcd",
    _truck_category,
    NUSCENES_LISTS._replace(
        categories=(
            *CATEGORIES,
            "vehicle.other",
            "vehicle.ego_trailer",
            "static_object.traffic_sign",
        ),
        channels=TRUCKSCENES_CHANNELS,
        empty=("ego_motion_cabin", "ego_motion_chassis"),
    ),
)

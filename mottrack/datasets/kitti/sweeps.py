"""KITTI sweeps: `velodyne/<sequence>/<frame>.bin`, float32 x, y, z, reflectance."""

from __future__ import annotations

from pathlib import Path

from mottrack.core.arrays import F32
from mottrack.datasets.files import check_range, check_unit_interval, read_floats


def sweep_path(folder: Path, frame: int) -> Path:
    """Return the file of one frame."""
    return folder / f"{frame:06d}.bin"


def recorded_frames(folder: Path, count: int) -> list[int]:
    """Return those of the frames 0 .. count - 1 that have a sweep, ascending.

    KITTI's own recording misses some (four of sequence 0001).
    """
    present = {path.stem for path in folder.glob("*.bin")}
    return [frame for frame in range(count) if f"{frame:06d}" in present]


def last_frame(folder: Path) -> int:
    """Return the highest frame number that has a sweep, -1 where there is none."""
    stems = [path.stem for path in folder.glob("[0-9][0-9][0-9][0-9][0-9][0-9].bin")]
    return int(max(stems, default="-1"))


def read_points(path: Path) -> tuple[F32, F32]:
    """Return xyz_m (N, 3) in the ego frame and reflectance (N,) in [0, 1].

    Raises:
        DataError: missing, empty or cut file, a value that is not finite or out of range.

    """
    values = read_floats(path, 4)
    xyz_m, reflectance = values[:, :3], values[:, 3]
    check_range(path, xyz_m)
    check_unit_interval(path, reflectance)
    return xyz_m, reflectance

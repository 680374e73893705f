"""The camera of a KITTI sequence, in whose frame KITTI's files have boxes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Self

from mottrack.core import Pose
from mottrack.core.arrays import F64
from mottrack.datasets.kitti.boxes import LARGEST, NOMINAL, PROJECTION, ImageSize
from mottrack.datasets.kitti.poses import read_calibration
from mottrack.datasets.kitti.write import CAMERA_T_EGO


@dataclass(frozen=True)
class Camera:
    """Where a sequence's camera is, and how it projects.

    ego_T_camera: rectified left camera -> ego. projection: (3, 4) to pixels. size: of the image.
    """

    ego_T_camera: Pose
    projection: F64
    size: ImageSize = LARGEST

    @classmethod
    def nominal(cls) -> Self:
        """Return KITTI's mounting, for runs on other data sets."""
        return cls(CAMERA_T_EGO.inverse(), PROJECTION, NOMINAL)

    @classmethod
    def of_file(cls, path: Path) -> Self:
        """Read it from a calibration file.

        Raises:
            DataError: the file is missing or damaged.
        """
        calibration = read_calibration(path)
        return cls(calibration.ego_T_camera, calibration.projection)

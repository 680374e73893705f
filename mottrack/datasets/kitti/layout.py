"""Where the files of one KITTI sequence are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mottrack.datasets.files import inside
from mottrack.datasets.kitti.config import KittiConfig
from mottrack.datasets.kitti.labels import DETECTOR_TYPES


@dataclass(frozen=True)
class SequenceFiles:
    """The paths of one sequence; none of them need exist."""

    config: KittiConfig
    sequence: str

    @property
    def calibration(self) -> Path:
        """`calib/<sequence>.txt`."""
        return self._text("calib")

    @property
    def labels(self) -> Path:
        """`label_02/<sequence>.txt`."""
        return self._text("label_02")

    @property
    def camera_poses(self) -> Path:
        """`poses/<sequence>.txt`."""
        return self._text("poses")

    @property
    def oxts(self) -> Path:
        """`oxts/<sequence>.txt`."""
        return self._text("oxts")

    @property
    def sweeps(self) -> Path:
        """`velodyne/<sequence>`."""
        root = self.config.velodyne_root or self.config.root / self.config.split / "velodyne"
        return root / self.sequence

    @property
    def detections(self) -> tuple[Path, ...]:
        """`<detections>/<Class>/<sequence>.txt` of the classes for which there is such a file."""
        if self.config.detections is None:
            return ()
        folder = inside(self.config.root, self.config.detections)
        paths = (folder / kind / f"{self.sequence}.txt" for kind in DETECTOR_TYPES.values())
        return tuple(path for path in paths if path.is_file())

    @property
    def detections_at(self) -> Path:
        """`<detections>/{Pedestrian,Car,Cyclist}/<sequence>.txt`, the root where none are read."""
        if self.config.detections is None:
            return self.config.root
        kinds = ",".join(DETECTOR_TYPES.values())
        return self.config.root / self.config.detections / f"{{{kinds}}}" / f"{self.sequence}.txt"

    def _text(self, folder: str) -> Path:
        return self.config.root / self.config.split / folder / f"{self.sequence}.txt"

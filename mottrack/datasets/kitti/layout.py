"""Where the files of one KITTI sequence are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mottrack.datasets.detection_files import is_general, located
from mottrack.datasets.kitti.config import KittiConfig
from mottrack.datasets.kitti.labels import DETECTOR_TYPES
from mottrack.formats.files import inside, present


@dataclass(frozen=True)
class SequenceFiles:
    """The paths of one sequence; none of them need exist."""

    config: KittiConfig
    sequence: str

    def text(self, folder: str) -> Path:
        """Return `<folder>/<sequence>.txt` of `calib`, `label_02`, `poses` or `oxts`."""
        return self.config.root / self.config.split / folder / f"{self.sequence}.txt"

    @property
    def sweeps(self) -> Path:
        """`velodyne/<sequence>`, the folder of `<frame>.bin`."""
        root = self.config.velodyne_root or self.config.root / self.config.split / "velodyne"
        return root / self.sequence

    def sweep(self, frame: int) -> Path:
        """Return the sweep of one frame."""
        return self.sweeps / f"{frame:06d}.bin"

    def recorded_frames(self, count: int) -> list[int]:
        """Return those of the frames 0 .. count - 1 that have a sweep, ascending.

        KITTI's own recording misses some (four of sequence 0001).
        """
        present = {path.stem for path in self.sweeps.glob("*.bin")}
        return [frame for frame in range(count) if f"{frame:06d}" in present]

    def last_frame(self) -> int:
        """Return the highest frame number that has a sweep, -1 where there is none."""
        stems = [path.stem for path in self.sweeps.glob("[0-9][0-9][0-9][0-9][0-9][0-9].bin")]
        return int(max(stems, default="-1"))

    @property
    def detections(self) -> tuple[Path, ...]:
        """`<detections>/<Class>/<sequence>.txt` of the classes for which there is such a file."""
        if self.config.detections is None or is_general(self.config.detections):
            return ()
        folder = inside(self.config.root, self.config.detections)
        paths = (folder / kind / f"{self.sequence}.txt" for kind in DETECTOR_TYPES.values())
        return tuple(path for path in paths if present(path))

    @property
    def detections_at(self) -> Path:
        """`<detections>/{Pedestrian,Car,Cyclist}/<sequence>.txt`, the root where none are read."""
        if self.config.detections is None:
            return self.config.root
        if is_general(self.config.detections):
            return located(self.config.root, self.config.detections)
        kinds = ",".join(DETECTOR_TYPES.values())
        return self.config.root / self.config.detections / f"{{{kinds}}}" / f"{self.sequence}.txt"

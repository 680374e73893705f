"""A KITTI tracking data set, read as it was downloaded."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

from mottrack.datasets.choice import chosen_scenes, require_scene
from mottrack.datasets.faults import MissingError
from mottrack.datasets.files import existing_folder
from mottrack.datasets.kitti.config import KittiConfig
from mottrack.datasets.kitti.layout import SequenceFiles
from mottrack.datasets.kitti.scene import KittiScene


class Kitti:
    """The 21 training or 29 test sequences of KITTI tracking, or those that are there.

    The ego frame is the Velodyne's. The world starts at the first frame, z-up; see
    `mottrack.datasets.kitti.poses`. Only objects in the camera's view are labelled: every frame
    says so in `labelled_azimuth_rad`.
    """

    Config = KittiConfig

    def __init__(self, config: KittiConfig) -> None:
        self._config = config
        self._folder: Path = existing_folder(config.root / config.split, "split")

    @property
    def name(self) -> str:
        """Name of the data set."""
        return "kitti"

    @cached_property
    def scene_names(self) -> tuple[str, ...]:
        """The chosen sequences, or all that have a calibration."""
        calibrations = existing_folder(self._folder / "calib", "calib")
        present = tuple(sorted(path.stem for path in calibrations.glob("*.txt")))
        if not present:
            raise MissingError(calibrations, "sequences", "none", "<sequence>.txt")
        return chosen_scenes(self._config.scenes, present)

    def scene(self, name: str) -> KittiScene:
        """Open one sequence.

        Raises:
            ConfigError: no sequence has that name.
            DataError: a file of it is missing or damaged.

        """
        require_scene(name, self.scene_names)
        return KittiScene(SequenceFiles(self._config, name))

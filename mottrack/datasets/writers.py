"""Formats of data sets that can be written: of the embedded world, or of any scenes."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from mottrack.core import ConfigError, Scene
from mottrack.core.errors import unknown_name
from mottrack.datasets.synthetic import SyntheticConfig, SyntheticDataset

Write = Callable[..., tuple[str, ...]]
"""Takes scenes, the root and, where the format has versions, one of them; returns names."""


@dataclass(frozen=True)
class Format:
    """A format that can be written.

    writer: `module:function`, which writes scenes as they are.
    sweep_hz: rate of the sensor in that data set. key_hz: rate of its labels.
    detections: where the detection file goes, as the reader's option takes it; empty where
        detections are found without one.
    versions: of the data set, the first one by default; empty where it has none.
    rehearsal: likewise, for scenes of the embedded world: adds what makes the real data set hard.
    reader: settings with which all of what is written is read.
    """

    writer: str
    sweep_hz: int
    key_hz: int
    detections: str = ""
    versions: tuple[str, ...] = ()
    rehearsal: str = ""
    reader: Mapping[str, object] = field(default_factory=dict)

    def write(
        self,
        scenes: Iterable[Scene],
        root: Path,
        version: str | None = None,
        *,
        rehearse: bool = False,
    ) -> tuple[str, ...]:
        """Write the scenes; return their names in the new data set."""
        target = self.rehearsal if rehearse and self.rehearsal else self.writer
        module, _, name = target.partition(":")
        function: Write = getattr(importlib.import_module(module), name)
        return function(scenes, root) if version is None else function(scenes, root, version)


_VERSIONS = ("v1.0-trainval", "v1.0-mini")
_RESULTS = "detections/synthetic.json"
_NUSCENES = "mottrack.datasets.nuscenes.write"
# rates are those of the real data sets: they decide which sweeps and key frames are written
FORMATS = {
    "nuscenes": Format(
        f"{_NUSCENES}:write_nuscenes",
        20,
        2,
        _RESULTS,
        _VERSIONS,
        f"{_NUSCENES}:write_rehearsal",
        {"rate_hz": 20, "detector_velocity": True},
    ),
    "t4": Format(f"{_NUSCENES}:write_t4", 10, 10, _RESULTS, reader={"detector_velocity": True}),
    "truckscenes": Format(
        f"{_NUSCENES}:write_truckscenes",
        10,
        2,
        _RESULTS,
        _VERSIONS,
        reader={"detector_velocity": True},
    ),
    "kitti": Format("mottrack.datasets.kitti.write:write_kitti", 10, 10, "detections/pointrcnn"),
    "argoverse2": Format(
        "mottrack.datasets.argoverse2.write:write_argoverse2", 10, 10, "detections.feather"
    ),
    "folder": Format("mottrack.datasets.folder.write:write_folder", 10, 10),
    "ros": Format("mottrack.datasets.ros.write:write_ros", 10, 10),
}


def require_writable(root: Path, format_name: str, version: str | None) -> Format:
    """Return the format of a name.

    Raises:
        ConfigError: the format or the version is unknown, or the folder is not empty.
    """
    if format_name not in FORMATS:
        raise unknown_name("format", format_name, FORMATS)
    if version is not None and version not in FORMATS[format_name].versions:
        raise unknown_name(f"version of {format_name}", version, FORMATS[format_name].versions)
    if root.exists() and (not root.is_dir() or any(root.iterdir())):
        raise ConfigError(f"{root} is not empty, expected a new folder")
    return FORMATS[format_name]


def write_synthetic(
    root: Path,
    format_name: str,
    world: SyntheticConfig,
    version: str | None = None,
) -> tuple[str, ...]:
    """Write scenes of the embedded world in a format; return the names they have there.

    Args:
        root: new folder.
        format_name: one of `FORMATS`, which sets the rates of sweeps and key frames.
        world: the scenes.
        version: of the format; its first one by default.

    Raises:
        ConfigError: the format or the version is unknown, or the folder is not empty.
    """
    chosen = require_writable(root, format_name, version)
    rates = {"sweep_hz": chosen.sweep_hz, "key_hz": chosen.key_hz}
    dataset = SyntheticDataset(world.model_copy(update=rates))
    scenes = (dataset.scene(name) for name in dataset.scene_names)
    return chosen.write(scenes, root, version, rehearse=True)

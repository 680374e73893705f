"""Scenes of the embedded world written in the formats of public data sets, to test readers on."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from mottrack.core import ConfigError, Scene
from mottrack.core.errors import unknown_name
from mottrack.datasets.synthetic import SyntheticConfig, SyntheticDataset

Write = Callable[..., tuple[str, ...]]
"""Takes scenes, the root and, where the format has versions, one of them; returns names."""


@dataclass(frozen=True)
class Format:
    """A format that can be written."""

    writer: str
    """`module:function`"""
    sweep_hz: int
    """Rate of the sensor in that data set."""
    key_hz: int
    """Rate of its labels."""
    detections: str
    """Where the detection file goes, as the reader's option takes it."""

    versions: tuple[str, ...] = ()
    """Of the data set, the first one by default; empty where it has none."""

    def write(
        self, scenes: Iterable[Scene], root: Path, version: str | None = None
    ) -> tuple[str, ...]:
        """Write the scenes; return their names in the new data set."""
        module, _, name = self.writer.partition(":")
        function: Write = getattr(importlib.import_module(module), name)
        return function(scenes, root) if version is None else function(scenes, root, version)


# rates are those of the real data sets: they decide which sweeps and key frames are written
FORMATS = {
    "nuscenes": Format(
        "mottrack.datasets.nuscenes.write:write_rehearsal",
        20,
        2,
        "detections/synthetic.json",
        ("v1.0-trainval", "v1.0-mini"),
    ),
    "t4": Format("mottrack.datasets.nuscenes.write:write_t4", 10, 10, "detections/synthetic.json"),
    "truckscenes": Format(
        "mottrack.datasets.nuscenes.write:write_truckscenes",
        10,
        2,
        "detections/synthetic.json",
        ("v1.0-trainval", "v1.0-mini"),
    ),
    "kitti": Format("mottrack.datasets.kitti.write:write_kitti", 10, 10, "detections/pointrcnn"),
    "argoverse2": Format(
        "mottrack.datasets.argoverse2.write:write_argoverse2", 10, 10, "detections.feather"
    ),
}


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
    if format_name not in FORMATS:
        raise unknown_name("format", format_name, FORMATS)
    if version is not None and version not in FORMATS[format_name].versions:
        raise unknown_name(f"version of {format_name}", version, FORMATS[format_name].versions)
    if root.exists() and (not root.is_dir() or any(root.iterdir())):
        raise ConfigError(f"{root} is not empty, expected a new folder")
    chosen = FORMATS[format_name]
    rates = {"sweep_hz": chosen.sweep_hz, "key_hz": chosen.key_hz}
    dataset = SyntheticDataset(world.model_copy(update=rates))
    scenes = (dataset.scene(name) for name in dataset.scene_names)
    return chosen.write(scenes, root, version)

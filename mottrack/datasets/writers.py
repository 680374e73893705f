"""Scenes of the embedded world written in the formats of public data sets, to test readers on."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from mottrack.core import ConfigError, Scene
from mottrack.core.errors import unknown_name
from mottrack.datasets.synthetic import SyntheticConfig, SyntheticDataset

Write = Callable[[Iterable[Scene], Path], tuple[str, ...]]


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

    def write(self, scenes: Iterable[Scene], root: Path) -> tuple[str, ...]:
        """Write the scenes; return their names in the new data set."""
        module, _, name = self.writer.partition(":")
        function: Write = getattr(importlib.import_module(module), name)
        return function(scenes, root)


# rates are those of the real data sets: they decide which sweeps and key frames are written
FORMATS = {
    "nuscenes": Format(
        "mottrack.datasets.nuscenes.write:write_nuscenes", 20, 2, "detections/synthetic.json"
    ),
    "kitti": Format("mottrack.datasets.kitti.write:write_kitti", 10, 10, "detections/pointrcnn"),
    "argoverse2": Format(
        "mottrack.datasets.argoverse2.write:write_argoverse2", 10, 10, "detections.feather"
    ),
}


def write_synthetic(
    root: Path, format_name: str, scenes: int, *, seed: int = 0, duration_s: float = 20.0
) -> tuple[str, ...]:
    """Write scenes of the embedded world in a format; return the names they have there.

    Raises:
        ConfigError: the format is unknown, or the folder is not empty.
    """
    if format_name not in FORMATS:
        raise unknown_name("format", format_name, FORMATS)
    if root.exists() and (not root.is_dir() or any(root.iterdir())):
        raise ConfigError(f"{root} is not empty, expected a new folder")
    chosen = FORMATS[format_name]
    config = SyntheticConfig(
        scenes=scenes,
        seed=seed,
        duration_s=duration_s,
        sweep_hz=chosen.sweep_hz,
        key_hz=chosen.key_hz,
    )
    world = SyntheticDataset(config)
    return chosen.write((world.scene(name) for name in world.scene_names), root)

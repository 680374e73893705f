"""Data sets converted from one format to another, and what that loses, measured by reading back."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from mottrack.core import ConfigError, Dataset, Scene
from mottrack.datasets.losses import Loss, scene_losses
from mottrack.datasets.writers import require_writable

Open = Callable[[Mapping[str, object]], Dataset]
"""Opens a data set by its settings, `kind` and `root` among them."""


@dataclass(frozen=True)
class Target:
    """Where a data set is converted to: a new folder, a format, a version where it has some."""

    root: Path
    format: str
    version: str | None = None


@dataclass(frozen=True)
class Converted:
    """A scene that was converted.

    source, name: what it was called, and what it is called now.
    losses: what is not as it was.
    """

    source: str
    name: str
    losses: tuple[Loss, ...]


def convert(dataset: Dataset, target: Target, opener: Open) -> Iterator[Converted]:
    """Write all scenes of a data set in a format; then read each back and compare.

    Args:
        dataset: what is converted.
        target: the new data set.
        opener: opens a data set.

    Raises:
        ConfigError: the format or the version is unknown, or the folder is not empty.
        DataError: a file of the data set is damaged.
    """
    chosen = require_writable(target.root, target.format, target.version)
    scenes = (dataset.scene(name) for name in dataset.scene_names)
    names = chosen.write(scenes, target.root, target.version)
    if len(names) != len(dataset.scene_names):
        raise ConfigError(
            f"{target.format} wrote {len(names)} of {len(dataset.scene_names)} scenes"
        )
    for source, name in zip(dataset.scene_names, names, strict=True):
        before = dataset.scene(source)
        after = opener(_settings(target, chosen.reader, before)).scene(name)
        yield Converted(source, name, tuple(scene_losses(before, after)))


def _settings(target: Target, reader: Mapping[str, object], scene: Scene) -> dict[str, object]:
    """Return the settings that read all of what was written of a scene."""
    settings: dict[str, object] = {
        "kind": target.format,
        "root": str(target.root),
        "vehicle": None,
        **reader,
    }
    if target.version is not None:
        settings["version"] = target.version
    frames = [scene.frame(index) for index in range(len(scene))]
    detected = any(frame.detections is not None for frame in frames)
    labelled = any(frame.truth is not None for frame in frames)
    if target.format == "ros":
        settings["detections_topic"] = "/detections" if detected else None
        settings["truth_topic"] = "/truth" if labelled else None
    elif target.format in _DETECTION_FILES and detected:
        settings["detections"] = _DETECTION_FILES[target.format]
    return settings


_DETECTION_FILES = {
    "nuscenes": "detections/synthetic.json",
    "t4": "detections/synthetic.json",
    "truckscenes": "detections/synthetic.json",
    "argoverse2": "detections.feather",
}
"""The detection file of formats whose reader must be told of it."""

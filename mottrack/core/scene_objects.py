"""The objects that a tracker received at the key frames of a scene, as a file beside its result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from mottrack.core.arrays import I64
from mottrack.core.checks import Column, Columns
from mottrack.core.errors import InputError, ResultError
from mottrack.core.objects import Objects
from mottrack.core.snapshot import ObjectTable
from mottrack.core.storage import read_arrays, write_arrays

FORMAT = "mottrack scene objects 1"


@dataclass(frozen=True, slots=True)
class SceneObjects(ObjectTable):
    """Detections or clusters of a scene with their measured velocities, world frame."""

    COLUMNS: ClassVar[Columns] = {**ObjectTable.COLUMNS, "frame": Column(np.int64)}

    frame: I64
    """(D,) row of the scene's FrameTable."""

    @classmethod
    def at(cls, frame: int, objects: Objects) -> SceneObjects:
        """Make the table of the objects of one key frame."""
        table = ObjectTable.of(objects)
        columns = {name: getattr(table, name) for name in ObjectTable.COLUMNS}
        return cls(**columns, frame=np.full(len(table), frame))


def save_objects(path: Path, steps: Sequence[SceneObjects]) -> None:
    """Store the key frames of one scene, atomically."""
    table = SceneObjects.stacked(steps)
    arrays = {name: getattr(table, name) for name in SceneObjects.COLUMNS}
    write_arrays(path, arrays, FORMAT)


def load_objects(path: Path) -> SceneObjects:
    """Read what `save_objects` wrote.

    Raises:
        ResultError: the file is missing, damaged, or of another version.
    """
    arrays = read_arrays(path, FORMAT)
    try:
        return SceneObjects(**{name: arrays[name] for name in SceneObjects.COLUMNS})
    except InputError as error:
        raise ResultError(path, error.field, error.value, error.expected) from error

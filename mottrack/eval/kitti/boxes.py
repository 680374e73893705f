"""Boxes in KITTI's tracking text format: labels and results."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64, Texts
from mottrack.formats.kitti_rows import IMAGE_BOX, read_kitti_rows

MAX_NUMBER = 1e6
"""Of pixels and metres: KITTI's own fill values are -1, -10 and -1000."""


@dataclass(frozen=True, slots=True)
class KittiBoxes:
    """Boxes of one sequence, in the order of the file."""

    frame: I64
    """(N,)"""
    id: I64
    """(N,) -1 for regions without labels."""
    kind: Texts
    """(N,) type, lower case."""
    truncation: F64
    """(N,) 0 inside the image, 1 or 2 cut off at its edge, -1 for regions."""
    occlusion: F64
    """(N,) 0 visible, 1 partly, 2 largely hidden, 3 unknown, -1 for regions."""
    image_box: F64
    """(N, 4) left, top, right, bottom in pixels."""
    box: F64
    """(N, 7) x, y, z, l, w, h, yaw with z up: camera coordinates (x, z, -y), centre of the box."""
    score: F64
    """(N,) 0 where the file has none."""

    def __len__(self) -> int:
        return len(self.frame)

    def select(self, index: NDArray[Any]) -> "KittiBoxes":
        """Return the rows that a mask or index picks."""
        return KittiBoxes(*(getattr(self, name)[index] for name in self.__dataclass_fields__))


def read_boxes(path: Path) -> KittiBoxes:
    """Read a label or result file; raises DataError that names the broken line."""
    table = read_kitti_rows(path)
    for name in (*IMAGE_BOX, "h", "w", "l", "x", "y", "z", "ry"):
        table.refuse(name, np.abs(table[name]) > MAX_NUMBER, f"within {MAX_NUMBER:g}")
    height, width, length = (table[name] for name in "hwl")
    bottom_centre = table["x"], table["z"], -table["y"] + height / 2
    return KittiBoxes(
        frame=table["frame"],
        id=table["track"],
        kind=np.char.lower(table["type"]),
        truncation=table["truncated"],
        occlusion=table["occluded"],
        image_box=table.stacked(IMAGE_BOX),
        box=np.stack([*bottom_centre, length, width, height, -table["ry"]], axis=1),
        score=table["score"],
    )

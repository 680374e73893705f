"""Boxes in KITTI's tracking text format: labels and results."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64, Texts
from mottrack.core.errors import DataError
from mottrack.formats.text_rows import finite_numbers, read_lines

COLUMNS = 17
"""frame, id, type, truncation, occlusion, alpha, box (4), h w l, x y z, heading; then a score."""


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
    rows = [(n, line.split()) for n, line in enumerate(read_lines(path), 1) if line.strip()]
    kinds = [fields[2].lower() if len(fields) > 2 else "" for _, fields in rows]
    values = np.array([_numbers(path, n, fields) for n, fields in rows]).reshape(-1, COLUMNS)
    return _boxes(values, np.array(kinds, np.str_))


def _numbers(path: Path, line: int, fields: list[str]) -> list[float]:
    """Return the numbers of a line in the order of the format, without the type, with a score."""
    if len(fields) not in (COLUMNS, COLUMNS + 1):
        raise DataError(path, f"line {line}", f"{len(fields)} fields", f"{COLUMNS} or one more")
    numbers = finite_numbers(path, line, [*fields[:2], *fields[3:]])
    return [*numbers, 0.0][:COLUMNS]


def _boxes(values: F64, kind: Texts) -> KittiBoxes:
    height, width, length, x, y, z, heading = values[:, 9:16].T
    return KittiBoxes(
        frame=values[:, 0].astype(np.int64),
        id=values[:, 1].astype(np.int64),
        kind=kind,
        truncation=values[:, 2],
        occlusion=values[:, 3],
        image_box=values[:, 5:9],
        box=np.stack([x, z, -y + height / 2, length, width, height, -heading], axis=1),
        score=values[:, 16],
    )

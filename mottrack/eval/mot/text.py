"""MOTChallenge text: `frame, id, left, top, width, height, confidence, class, visibility`.

Files of ten columns (MOT15, and results) have a position on the ground in place of the class.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64
from mottrack.core.errors import DataError
from mottrack.formats.text_rows import finite_numbers, read_lines

MIN_FIELDS = 6
FIELDS_WITH_CLASS = 9


@dataclass(frozen=True, slots=True)
class MotBoxes:
    """Boxes of one sequence, by frame."""

    frame: I64
    """(N,) ascending."""
    id: I64
    """(N,)"""
    box: F64
    """(N, 4) left, top, right, bottom in pixels."""
    confidence: F64
    """(N,) 1 where the file has none."""
    kind: I64
    """(N,) class number, -1 where the file has none."""

    def __len__(self) -> int:
        return len(self.frame)

    def select(self, index: NDArray[Any]) -> "MotBoxes":
        """The rows that a mask or index picks."""
        return MotBoxes(*(getattr(self, name)[index] for name in self.__dataclass_fields__))


def read_boxes(path: Path) -> MotBoxes:
    """Reads a file; raises DataError that names the broken line or an identity twice in a frame."""
    lines = enumerate(read_lines(path), 1)
    rows = [_numbers(path, n, line) for n, line in lines if line.strip()]
    values = np.array(rows, np.float64).reshape(-1, 8)
    values = values[np.argsort(values[:, 0], kind="stable")]
    boxes = MotBoxes(
        frame=values[:, 0].astype(np.int64),
        id=values[:, 1].astype(np.int64),
        box=np.column_stack([values[:, 2:4], values[:, 2:4] + values[:, 4:6]]),
        confidence=values[:, 6],
        kind=values[:, 7].astype(np.int64),
    )
    _require_unique(path, boxes)
    return boxes


def _numbers(path: Path, line: int, text: str) -> list[float]:
    """Frame, id, box, confidence and class of a line."""
    fields = text.replace(",", " ").split()
    if len(fields) < MIN_FIELDS:
        raise DataError(path, f"line {line}", f"{len(fields)} fields", f"at least {MIN_FIELDS}")
    numbers = finite_numbers(path, line, fields[:8])
    kind = numbers[7] if len(fields) == FIELDS_WITH_CLASS else -1.0
    confidence = numbers[6] if len(numbers) > MIN_FIELDS else 1.0
    return [*numbers[:MIN_FIELDS], confidence, kind]


def _require_unique(path: Path, boxes: MotBoxes) -> None:
    pairs, counts = np.unique(np.stack([boxes.frame, boxes.id]), axis=1, return_counts=True)
    if (counts > 1).any():
        frame, identity = pairs[:, np.argmax(counts)]
        raise DataError(path, f"id {identity}", f"twice in frame {frame}", "each id once a frame")

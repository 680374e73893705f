"""Boxes of MOTChallenge text files, and what of them is hardly meant."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.concerns import Concern
from mottrack.formats.columns import Columns
from mottrack.formats.mot_rows import BOX, read_mot_rows

PEDESTRIAN = 1
DISTRACTORS = (2, 7, 8, 12)
"""Of MOT16 and later: person on vehicle, static person, distractor, reflection."""
CLASSES = 13
"""Numbered from 1 in MOT16, MOT17 and MOT20."""


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

    def select(self, index: NDArray[Any]) -> MotBoxes:
        """Return the rows that a mask or index picks."""
        return MotBoxes(*(getattr(self, name)[index] for name in self.__dataclass_fields__))


def read_boxes(path: Path) -> MotBoxes:
    """Read a file of lines `frame, id, left, top, width, height, confidence, class, ...`.

    The eighth column is the class where every row has one of the 13 classes there; elsewhere, as
    in MOT15 and in results, it is -1 or a place on the ground, and there are no classes.

    Raises:
        DataError: a broken line, a size below 0, or an identity twice in a frame.
    """
    table = read_mot_rows(path)
    left_top, size = table.stacked(BOX[:2]), table.stacked(BOX[2:])
    return MotBoxes(
        frame=table["frame"].astype(np.int64),
        id=table["id"].astype(np.int64),
        box=np.hstack([left_top, left_top + size]),
        confidence=table["confidence"],
        kind=_classes(table),
    )


def _classes(table: Columns) -> I64:
    """Return the class numbers (N,), -1 where the column holds something else.

    Raises:
        DataError: some rows have a class, others a number that is none.
    """
    values = table["class"]
    known: Mask = np.isin(values, np.arange(1, CLASSES + 1))
    if known.all():
        return values.astype(np.int64)
    # a place on the ground may be a whole number by chance, minus one says that there is none
    if known.any() and np.isin(values, (-1, *range(CLASSES + 1))).all():
        table.refuse("class", ~known, f"1 .. {CLASSES} as in the other rows")
    return np.full(len(table), -1)


def concerns(truth: MotBoxes, tracks: MotBoxes, paths: tuple[Path, Path]) -> Iterator[Concern]:
    """Yield what is hardly meant in a pair of files, of which `paths` are truth and tracks."""
    truth_path, tracks_path = paths
    classes = truth.kind[truth.kind >= 1]
    counted: Mask = truth.confidence != 0
    if len(classes):
        counted &= truth.kind == PEDESTRIAN
    if not counted.any():
        found = ", ".join(f"{kind}: {n}" for kind, n in zip(*_counted(truth.kind), strict=True))
        text = f"{truth_path}: no row counts (rows by class: {found or 'none'})"
        yield Concern("nothing to score", len(truth), text)
    if not len(tracks):
        yield Concern("no rows", 0, f"{tracks_path}: no track at all")
    for path, boxes in ((truth_path, truth), (tracks_path, tracks)):
        flat = (boxes.box[:, 2:] <= boxes.box[:, :2]).any(axis=1)
        yield from _at(path, boxes, np.asarray(flat), "boxes without an area")
        yield from _at(path, boxes, np.less(boxes.id, 0), "ids below 0")
        yield from _at(
            path, boxes, np.less(boxes.frame, 1), "frames below 1, where counting begins"
        )
    if len(truth) and len(tracks):
        first, last = int(truth.frame[0]), int(truth.frame[-1])
        outside: Mask = np.logical_or(tracks.frame < first, tracks.frame > last)
        yield from _at(tracks_path, tracks, outside, "tracks outside the frames of the truth")


def _counted(values: I64) -> tuple[list[int], list[int]]:
    kinds, counts = np.unique(values, return_counts=True)
    return kinds.tolist(), counts.tolist()


def _at(path: Path, boxes: MotBoxes, wrong: Mask, kind: str) -> Iterator[Concern]:
    if wrong.any():
        row = int(np.argmax(wrong))
        place = f"{path}: id {boxes.id[row]} in frame {boxes.frame[row]}"
        yield Concern(kind, int(np.count_nonzero(wrong)), place)

"""KITTI's text files of boxes: `label_02` (truth) and the detections that AB3DMOT reads."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I64, Texts
from mottrack.datasets.files import Column, check_boxes, read_table, refuse_rows, repeated_rows
from mottrack.datasets.kitti.boxes import CameraBoxes

DONT_CARE = "DontCare"
DETECTOR_TYPES = {1: "Pedestrian", 2: "Car", 3: "Cyclist"}
"""The numbers of the AB3DMOT text format."""

_BOX = tuple(Column(name) for name in ("h", "w", "l", "x", "y", "z", "ry"))
_IMAGE = tuple(Column(name) for name in ("x1", "y1", "x2", "y2"))
_LABEL = (
    Column("frame", int),
    Column("track", int),
    Column("type", str),
    Column("truncated"),
    Column("occluded"),
    Column("alpha"),
    *_IMAGE,
    *_BOX,
)
_DETECTION = (Column("frame", int), Column("type", int), *_IMAGE, Column("score"), *_BOX)
MAX_FRAME = 999_999
"""A frame's file name has six digits."""


@dataclass(frozen=True)
class LabelledBoxes:
    """N rows of `label_02/<sequence>.txt`, `DontCare` left out.

    frame: (N,) frame index.
    track: (N,) identity.
    kind: (N,) KITTI's own type name.
    boxes: in the rectified camera frame.
    """

    frame: I64
    track: I64
    kind: Texts
    boxes: CameraBoxes


@dataclass(frozen=True)
class DetectedBoxes:
    """N rows of a detection file: frame (N,), type name (N,), score (N,) and camera boxes."""

    frame: I64
    kind: Texts
    score: F64
    boxes: CameraBoxes


def read_labels(path: Path) -> LabelledBoxes:
    """Read the truth of one sequence.

    Raises:
        DataError: a broken line, a size that is not positive, or a track twice in one frame.

    """
    table = read_table(path, _LABEL, optional=1)
    keep = table["type"] != DONT_CARE
    table = {name: values[keep] for name, values in table.items()}
    _check_rows(path, table)
    repeated = repeated_rows(np.column_stack([table["frame"], table["track"]]))
    refuse_rows(path, table, repeated, "track", "each track once a frame")
    return LabelledBoxes(table["frame"], table["track"], table["type"], _camera_boxes(table))


def read_detections(path: Path) -> DetectedBoxes:
    """Read detections of one sequence in the AB3DMOT text format.

    Its columns are frame, type (1 pedestrian, 2 car, 3 cyclist), x1, y1, x2, y2, score, h, w, l,
    x, y, z, ry, alpha, separated by commas; alpha may be absent.

    Raises:
        DataError: a broken line, an unknown type or a size that is not positive.

    """
    table = read_table(path, _DETECTION, separator=",", optional=1)
    _check_rows(path, table)
    known = np.isin(table["type"], list(DETECTOR_TYPES))
    refuse_rows(path, table, ~known, "type", f"one of {sorted(DETECTOR_TYPES)}")
    kind = np.array([DETECTOR_TYPES[number] for number in table["type"]], dtype=np.str_)
    return DetectedBoxes(table["frame"], kind, table["score"], _camera_boxes(table))


def _camera_boxes(table: dict[str, NDArray[Any]]) -> CameraBoxes:
    return CameraBoxes(
        bottom_m=np.column_stack([table["x"], table["y"], table["z"]]),
        size_hwl_m=np.column_stack([table["h"], table["w"], table["l"]]),
        ry_rad=table["ry"],
    )


def _check_rows(path: Path, table: dict[str, NDArray[Any]]) -> None:
    no_frame = (table["frame"] < 0) | (table["frame"] > MAX_FRAME)
    refuse_rows(path, table, no_frame, "frame", f"a frame number of 0 to {MAX_FRAME}")
    check_boxes(path, table, ("h", "w", "l"), ("x", "y", "z"), "ry")

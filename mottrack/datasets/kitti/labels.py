"""KITTI's text files of boxes: `label_02` (truth) and the detections that AB3DMOT reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mottrack.core.errors import DataError
from mottrack.datasets.kitti.boxes import CameraBoxes
from mottrack.formats.checks import check_ego_places, check_headings, check_sizes
from mottrack.formats.columns import Columns, ColumnSpec, specs
from mottrack.formats.kitti_rows import (
    DONT_CARE,
    IMAGE_BOX,
    MAX_FRAME,
    read_kitti_rows,
    read_object_rows,
    refuse_repeated_tracks,
)
from mottrack.formats.text_rows import Layout, read_text_columns

DETECTOR_TYPES = {1: "Pedestrian", 2: "Car", 3: "Cyclist"}
"""The numbers of the AB3DMOT text format."""

_DETECTION = (
    ColumnSpec("frame", int),
    ColumnSpec("type", int),
    *specs(*IMAGE_BOX, "score", "h", "w", "l", "x", "y", "z", "ry"),
)


def read_label_file(path: Path) -> Columns:
    """Read the truth of one sequence, or a tracker's result, `DontCare` left out.

    The columns are those of `label_02`: frame, track, type (KITTI's own name), ..., h, w, l, x, y,
    z, ry in the rectified camera frame; and the score of a result.

    Raises:
        DataError: a broken line, a size that is not positive, or a track twice in one frame.
    """
    table = read_kitti_rows(path)
    table = table.select(table["type"] != DONT_CARE)
    table.refuse("track", table["track"] < 0, "0 or more")
    _check_boxes(table)
    refuse_repeated_tracks(table)
    return table


def read_detection_file(path: Path) -> Columns:
    """Read detections of one sequence in the AB3DMOT text format.

    Its columns are frame, type (1 pedestrian, 2 car, 3 cyclist), x1, y1, x2, y2, score, h, w, l,
    x, y, z, ry, alpha, separated by commas; alpha may be absent. Types become KITTI's own names.

    Raises:
        DataError: a broken line, an unknown type or a size that is not positive.
    """
    table = read_text_columns(path, _DETECTION, Layout(",", optional=1))
    _check_boxes(table)
    known = np.isin(table["type"], list(DETECTOR_TYPES))
    table.refuse("type", ~known, f"one of {sorted(DETECTOR_TYPES)}")
    kind = np.array([DETECTOR_TYPES[number] for number in table["type"]], dtype=np.str_)
    return table.extended(type=kind)


def read_object_folder(folder: Path) -> Columns:
    """Read detections of one sequence in the format of the object benchmark, a file a frame.

    A file `<frame>.txt` has rows `type truncated occluded alpha x1 y1 x2 y2 h w l x y z ry score`,
    as OpenPCDet and MMDetection3D write for KITTI; the columns returned are those of
    `read_detection_file`.

    Raises:
        DataError: a file whose name is no frame's, a broken line or a size that is not positive.
    """
    tables = []
    for path in sorted(folder.glob("*.txt")):
        if not path.stem.isdecimal() or int(path.stem) > MAX_FRAME:
            raise DataError(path, "name", path.name, f"a frame number of 0 to {MAX_FRAME}")
        table = read_object_rows(path)
        table = table.extended(frame=np.full(len(table), int(path.stem)))
        _check_boxes(table)
        tables.append(table)
    names = ("frame", "type", *IMAGE_BOX, "score", "h", "w", "l", "x", "y", "z", "ry")
    arrays = {name: np.concatenate([table[name] for table in tables]) for name in names}
    return Columns(folder, arrays, np.arange(len(arrays["frame"])), lambda n, i: f"{n} of row {i}")


def _check_boxes(table: Columns) -> None:
    no_frame = (table["frame"] < 0) | (table["frame"] > MAX_FRAME)
    table.refuse("frame", no_frame, f"a frame number of 0 to {MAX_FRAME}")
    check_sizes(table, "h", "w", "l")
    check_ego_places(table, "x", "y", "z")
    check_headings(table, "ry")


def camera_boxes(table: Columns) -> CameraBoxes:
    """Return the boxes of the rows of a label or detection file."""
    return CameraBoxes(
        bottom_m=table.stacked(("x", "y", "z")),
        size_hwl_m=table.stacked(("h", "w", "l")),
        ry_rad=table["ry"],
    )

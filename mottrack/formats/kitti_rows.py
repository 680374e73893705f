"""Rows of KITTI's tracking text format: labels and results."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mottrack.core.arrays import F64, I64, Texts
from mottrack.core.storage import write_text
from mottrack.formats.columns import Columns, ColumnSpec, specs
from mottrack.formats.text_rows import read_text_columns

DONT_CARE = "DontCare"
TYPES = (
    "Car",
    "Van",
    "Truck",
    "Pedestrian",
    "Person",
    "Person_sitting",
    "Cyclist",
    "Tram",
    "Misc",
    DONT_CARE,
)
"""KITTI's own names; the development kit spells a sitting person in two ways."""
MAX_FRAME = 999_999
"""A frame's file name has six digits."""
IMAGE_BOX = ("x1", "y1", "x2", "y2")
_OBJECT = (
    ColumnSpec("type", str),
    *specs("truncated", "occluded", "alpha", *IMAGE_BOX, "h", "w", "l", "x", "y", "z", "ry"),
    ColumnSpec("score", default=0.0),
)
"""A row of the object benchmark, which has a file a frame."""
_COLUMNS = (ColumnSpec("frame", int), ColumnSpec("track", int), *_OBJECT)


def read_kitti_rows(path: Path) -> Columns:
    """Read labels or results of one sequence; the score is 0 where there is none.

    Raises:
        DataError: a broken line, or a frame that no file can have.
    """
    table = read_text_columns(path, _COLUMNS)
    no_frame = (table["frame"] < 0) | (table["frame"] > MAX_FRAME)
    table.refuse("frame", no_frame, f"a frame number of 0 to {MAX_FRAME}")
    return table


def read_object_rows(path: Path) -> Columns:
    """Read the rows of one frame in the format of the object benchmark.

    Raises:
        DataError: a broken line.
    """
    return read_text_columns(path, _OBJECT)


@dataclass(frozen=True)
class KittiResults:
    """N rows of a result file; lengths in metres, rectified camera frame.

    frame, track: (N,). kind: (N,) KITTI's type. alpha_rad: (N,) heading relative to the ray.
    image_box: (N, 4) left, top, right, bottom in pixels. size_hwl_m, bottom_m: (N, 3).
    ry_rad, score: (N,).
    """

    frame: I64
    track: I64
    kind: Texts
    alpha_rad: F64
    image_box: F64
    size_hwl_m: F64
    bottom_m: F64
    ry_rad: F64
    score: F64


def write_kitti_results(path: Path, rows: KittiResults) -> None:
    """Write a result file with the 18 columns that KITTI's and AB3DMOT's evaluators read."""
    numbers = np.column_stack(
        [rows.alpha_rad, rows.image_box, rows.size_hwl_m, rows.bottom_m, rows.ry_rad, rows.score]
    )
    lines = [
        f"{frame} {track} {kind} 0 0 {' '.join(f'{value:.6f}' for value in values)}\n"
        for frame, track, kind, values in zip(
            rows.frame, rows.track, rows.kind, numbers, strict=True
        )
    ]
    write_text(path, "".join(lines))


def refuse_repeated_tracks(table: Columns) -> None:
    """Raise `DataError` for a track that is twice in a frame."""
    keys = np.column_stack([table["frame"], table["track"]])
    table.refuse_repeated("track", keys, "each track once a frame")

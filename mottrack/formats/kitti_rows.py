"""Rows of KITTI's tracking text format: labels and results."""

from __future__ import annotations

from pathlib import Path

import numpy as np

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
_COLUMNS = (
    ColumnSpec("frame", int),
    ColumnSpec("track", int),
    ColumnSpec("type", str),
    *specs("truncated", "occluded", "alpha", *IMAGE_BOX, "h", "w", "l", "x", "y", "z", "ry"),
    ColumnSpec("score", default=0.0),
)


def read_kitti_rows(path: Path) -> Columns:
    """Read labels or results of one sequence; the score is 0 where there is none.

    Raises:
        DataError: a broken line, or a frame that no file can have.
    """
    table = read_text_columns(path, _COLUMNS)
    no_frame = (table["frame"] < 0) | (table["frame"] > MAX_FRAME)
    table.refuse("frame", no_frame, f"a frame number of 0 to {MAX_FRAME}")
    return table


def refuse_repeated_tracks(table: Columns) -> None:
    """Raise `DataError` for a track that is twice in a frame."""
    keys = np.column_stack([table["frame"], table["track"]])
    table.refuse_repeated("track", keys, "each track once a frame")

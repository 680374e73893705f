"""Rows of MOTChallenge text files: boxes in an image, of truth and of tracks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.core.storage import write_text
from mottrack.formats.columns import Columns, ColumnSpec, specs
from mottrack.formats.text_rows import Layout, check_whole, read_text_columns

BOX = ("left", "top", "width", "height")
MAX_PX = 1e6
"""No image is larger."""
NO_BOX = (-1.0, -1.0, -1.0, -1.0)
"""MOTChallenge's own entry where a box in the image is not known."""
_COLUMNS = (
    *specs("frame", "id", *BOX),
    ColumnSpec("confidence", default=1.0),
    ColumnSpec("class", default=-1.0),
)
_LAYOUT = Layout(optional=2, loose=True)
"""Visibility or a place on the ground may follow. Most files have commas, some white space."""


def read_mot_rows(path: Path) -> Columns:
    """Read lines `frame, id, left, top, width, height, confidence, class, ...`, sorted by frame.

    Raises:
        DataError: a broken line, a size below 0, or an identity twice in a frame.
    """
    table = read_text_columns(path, _COLUMNS, _LAYOUT)
    check_whole(table, "frame", "id")
    for name in BOX:
        table.refuse(name, np.abs(table[name]) > MAX_PX, f"within {MAX_PX:g} pixels")
    for name in ("width", "height"):
        table.refuse(name, table[name] < 0.0, "0 pixels or more")
    table = table.select(np.argsort(table["frame"], kind="stable"))
    keys = np.column_stack([table["frame"], table["id"]])
    table.refuse_repeated("id", keys, "each id once a frame")
    return table


@dataclass(frozen=True)
class MotResults:
    """N boxes of tracks.

    frame, id: (N,) frames from 1 on. box: (N, 4) left, top, width, height in pixels, `NO_BOX` where
    there is no image. confidence: (N,). place_m: (N, 3) x, y, z in the world.
    """

    frame: I64
    id: I64
    box: F64
    confidence: F64
    place_m: F64


def write_mot_results(path: Path, rows: MotResults) -> None:
    """Write lines `frame,id,left,top,width,height,confidence,x,y,z`, as MOT15 has them."""
    numbers = np.column_stack([rows.box, rows.confidence, rows.place_m])
    lines = [
        f"{frame},{identity},{','.join(f'{value:.6f}' for value in values)}\n"
        for frame, identity, values in zip(rows.frame, rows.id, numbers, strict=True)
    ]
    write_text(path, "".join(lines))

"""Tables of boxes, one row a box: csv, Parquet and feather files of detections and of tracks.

The columns are those of the csv files of own logs: x, y, z of the centre, length, width, height in
metres, yaw in radians from +x to +y, vx, vy in metres a second. A row says of which frame it is by
`stamp_ns` (nanoseconds), or by `token`, the data set's own name of the frame; and of which scene by
`scene`, which may be left out where a file holds a single one. Their order does not matter.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet
from numpy.typing import NDArray

from mottrack.core.checks import MAX_PLACE_M
from mottrack.core.errors import DataError
from mottrack.core.limits import MAX_ROWS
from mottrack.core.result import SceneResult
from mottrack.core.storage import write_bytes
from mottrack.formats.checks import check_headings, check_sizes
from mottrack.formats.columns import Columns, ColumnSpec, specs
from mottrack.formats.feather import checked_array, feather_names, read_feather_columns
from mottrack.formats.files import read_bytes
from mottrack.formats.text_rows import Layout, read_lines, read_text_columns

PLACE, SIZE, VELOCITY = ("x", "y", "z"), ("length", "width", "height"), ("vx", "vy")
SUFFIXES = (".csv", ".parquet", ".feather")
MAX_SPEED_MPS = 200.0
"""Faster is no road user: the number is damaged or of another unit."""
_STAMP, _TOKEN, _SCENE = (
    ColumnSpec("stamp_ns", int),
    ColumnSpec("token", str),
    ColumnSpec("scene", str),
)
_ID = ColumnSpec("id", str)
_BOX = (ColumnSpec("label", str), *specs("score", *PLACE, *SIZE, "yaw"))
_VELOCITY = tuple(ColumnSpec(name, blank=math.nan) for name in VELOCITY)
_OBSERVED = ColumnSpec("observed", int)


@dataclass(frozen=True)
class BoxRows:
    """The rows of a file, checked: one table for all scenes in it.

    table: with label, score, x .. yaw, vx and vy (NaN where not known), and of tracks id (text) and
        observed (0 or 1).
    keys: (N,) what names the frame of each row: its stamp or its token, as text.
    scenes: (N,) scene of each row; None where the file does not say.
    """

    table: Columns
    keys: NDArray[np.str_]
    scenes: NDArray[np.str_] | None

    def of_scene(self, scene: str) -> BoxRows:
        """Return the rows of a scene; all rows where the file names none."""
        if self.scenes is None:
            return self
        rows = np.flatnonzero(self.scenes == scene)
        return BoxRows(self.table.select(rows), self.keys[rows], self.scenes[rows])


def read_box_rows(path: Path, *, tracks: bool) -> BoxRows:
    """Read detections, or tracks, which have an id too.

    Raises:
        DataError: missing or damaged file, a missing or an unknown column, a value out of range.
    """
    names = _names(path)
    required = (*((_ID,) if tracks else ()), *_BOX)
    optional = (_STAMP, _TOKEN, _SCENE, *_VELOCITY, *((_OBSERVED,) if tracks else ()))
    known = {spec.name: spec for spec in (*required, *optional)}
    lacking = [spec.name for spec in required if spec.name not in names]
    if not {"stamp_ns", "token"} & set(names):
        lacking.append("stamp_ns or token")
    if lacking:
        expected = f"columns {', '.join(known)} (there: {', '.join(names)})"
        raise DataError(path, "column", f"without {', '.join(lacking)}", expected)
    unknown = [name for name in names if name not in known]
    if unknown and path.suffix == ".csv":
        raise DataError(path, "column", unknown[0], f"one of {', '.join(known)}")
    table = _read(path, tuple(known[name] for name in names if name in known))
    return _checked(table, tracks=tracks)


def _names(path: Path) -> list[str]:
    if path.suffix == ".csv":
        lines = read_lines(path)
        names = [name.strip() for name in lines[0].split(",")] if lines else []
    elif path.suffix == ".parquet":
        names = list(_parquet(path).schema_arrow.names)
    elif path.suffix == ".feather":
        names = feather_names(path)
    else:
        raise DataError(path, "suffix", path.suffix or "none", f"one of {', '.join(SUFFIXES)}")
    if len(set(names)) != len(names):
        raise DataError(path, "columns", ", ".join(names), "each name once")
    return names


def _read(path: Path, columns: tuple[ColumnSpec, ...]) -> Columns:
    if path.suffix == ".csv":
        return read_text_columns(path, columns, Layout(",", header=True))
    if path.suffix == ".feather":
        return read_feather_columns(path, columns)
    rows = _parquet(path).metadata.num_rows
    if rows > MAX_ROWS.value:
        raise DataError(path, "rows", rows, MAX_ROWS.expected("rows"))
    try:
        table = _parquet(path).read(columns=[spec.name for spec in columns])
        table.validate(full=True)
    except (pa.ArrowException, OSError, MemoryError, UnicodeDecodeError) as error:
        raise _unreadable(path, error) from error
    arrays = {s.name: checked_array(path, _as_text(table[s.name], s), s) for s in columns}
    return Columns(path, arrays, np.arange(rows), lambda name, row: f"{name} of row {row}")


def _as_text(values: Any, spec: ColumnSpec) -> Any:
    """Return identities as text, as which csv files hold them."""
    whole = spec.name == "id" and pa.types.is_integer(values.type)
    return values.cast(pa.string()) if whole else values


def _parquet(path: Path) -> Any:
    try:
        return pyarrow.parquet.ParquetFile(pa.py_buffer(read_bytes(path)))
    except (pa.ArrowException, OSError, MemoryError) as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: Exception) -> DataError:
    reason = str(error).splitlines()[0] if str(error) else type(error).__name__
    return DataError(path, "content", f"unreadable ({reason})", "a Parquet file")


def _checked(table: Columns, *, tracks: bool) -> BoxRows:
    check_sizes(table, *SIZE)
    check_headings(table, "yaw")
    for name in PLACE:
        table.refuse(name, np.abs(table[name]) > MAX_PLACE_M, f"within {MAX_PLACE_M:g} m")
    for name in ("label", "scene", "token"):
        if name in table.arrays:
            table.refuse(name, table[name] == "", "a name")
    for name in VELOCITY:
        if name not in table.arrays:
            table = table.extended(**{name: np.full(len(table), np.nan)})
        fast = np.abs(table[name]) > MAX_SPEED_MPS
        table.refuse(name, fast, f"within {MAX_SPEED_MPS:g} m/s")
    if tracks:
        if "observed" not in table.arrays:
            table = table.extended(observed=np.ones(len(table), np.int64))
        table.refuse("observed", ~np.isin(table["observed"], (0, 1)), "0 or 1")
    key = "stamp_ns" if "stamp_ns" in table.arrays else "token"
    scenes = table["scene"] if "scene" in table.arrays else None
    return BoxRows(table, table[key].astype(np.str_), scenes)


def track_rows(results: Iterable[SceneResult]) -> dict[str, NDArray[Any]]:
    """Return the columns of the tracks of some scenes, world frame, as this module's files have."""
    parts = [_rows_of(result) for result in results]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _rows_of(result: SceneResult) -> dict[str, NDArray[Any]]:
    tracks, frames = result.tracks, result.frames
    flat = tracks.flat()
    names = ("id", "label", "score", *PLACE, *SIZE, "yaw", *VELOCITY)
    return {
        "scene": np.full(len(tracks), result.name),
        "stamp_ns": frames.stamp_ns[tracks.frame],
        "token": frames.token[tracks.frame],
        **{name: flat[name] for name in names},
        "observed": tracks.observed.astype(np.int64),
    }


def write_box_rows(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write columns of equal length as the suffix says: csv, Parquet or feather.

    NaN is an empty cell of a csv file and stays NaN in the others.
    """
    arrays = {
        name: values.tolist() if values.dtype.kind == "U" else values
        for name, values in columns.items()
        if values.dtype.kind != "U" or (values != "").all()  # a data set without tokens
    }
    if path.suffix == ".csv":
        write_bytes(path, _csv(list(arrays), [list(values) for values in arrays.values()]))
        return
    sink = pa.BufferOutputStream()
    if path.suffix == ".parquet":
        pyarrow.parquet.write_table(pa.table(arrays), sink)
    else:
        pyarrow.feather.write_feather(pa.table(arrays), sink)
    write_bytes(path, sink.getvalue().to_pybytes())


def _csv(names: Sequence[str], columns: Sequence[Sequence[Any]]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    for row in zip(*columns, strict=True):
        writer.writerow(["" if value != value else value for value in row])
    return text.getvalue().encode()

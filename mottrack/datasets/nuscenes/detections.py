"""Detection files in the official format, from any detector.

`{"meta": {...}, "results": {sample_token: [box, ...], ...}}` with boxes in the world frame. The
files of a whole split have up to a gigabyte, so only the places of the samples are found, and the
boxes of a sample are parsed when they are asked for.
"""

from __future__ import annotations

import json
import mmap
import re
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import orjson
from numpy.typing import NDArray

from mottrack.core.arrays import F64
from mottrack.core.errors import DataError, ResultError
from mottrack.core.pose import wrap_angle
from mottrack.core.storage import read_arrays, write_arrays
from mottrack.datasets.detection_files import SCENE, is_general
from mottrack.datasets.nuscenes.dialect import NUSCENES, Dialect
from mottrack.datasets.scene_boxes import DetectionTable
from mottrack.formats.cache import cache_key, is_large
from mottrack.formats.checks import (
    check_rotations,
    check_sizes,
    check_upright,
    check_world_places,
)
from mottrack.formats.columns import Columns, ColumnSpec
from mottrack.formats.faults import MissingError, TruncatedError
from mottrack.formats.files import present
from mottrack.formats.nuscenes_tables import ROTATION, TRANSLATION, json_arrays
from mottrack.formats.rigid import quaternion_yaws
from mottrack.formats.table_stream import Row, opened

MAX_SPEED_MPS = 200.0
"""A faster object does not exist: its velocity is left out."""
QUATERNION_TOLERANCE = 1e-2
"""Detectors compute in float32 and round; the official evaluation normalises what they write."""
# fields of the official formats that are read, beside name and score
_FIELDS = (
    ColumnSpec("sample_token", str),
    TRANSLATION,
    ColumnSpec("size", width=3),
    ROTATION,
)
_RESULTS = re.compile(rb'"results"\s*:\s*\{')
_LIST = rb'"([^"\\]+)"\s*:\s*\[\s*(?=[{\]])'
_EMPTY = re.compile(rb'"results"\s*:\s*\{\s*\}')
_FIRST = re.compile(rb'"results"\s*:\s*\{\s*' + _LIST)
# to look for the bracket that ends a list is five times as fast as for a quotation mark
_NEXT = re.compile(rb"\]\s*,\s*" + _LIST)
_END_BYTES = 256
"""The closing braces are among the last bytes, white space between and after them included."""


_START_BYTES = 4096
"""Of a file, by which an export is told: a list of frames is OpenPCDet's, and MMDetection3D names
the first of its lists in the first line; the official format begins with meta or results."""


class DetectionFile:
    """The boxes of each sample of a detection file."""

    NAME, SCORE = "detection_name", "detection_score"

    def __init__(
        self, path: Path, cache_dir: Path | None = None, dialect: Dialect = NUSCENES
    ) -> None:
        self._path, self._cache_dir, self._dialect = path, cache_dir, dialect

    @property
    def known(self) -> tuple[str, ...]:
        """What `NAME` may be."""
        return self._dialect.detection_names

    @property
    def path(self) -> Path:
        """The file itself."""
        return self._path

    @cached_property
    def official(self) -> bool:
        """Whether it is meant to be in the official format, not a table or a detector's export."""
        if self._path.is_dir() or SCENE in str(self._path):
            return False
        if self._path.suffix != ".json" or not self._path.is_file():
            return not is_general(self._path) or self._path.suffix == ".json"
        with opened(self._path) as file:
            start = file.read(_START_BYTES).lstrip()
        return not start.startswith(b"[") and b'_3d"' not in start

    @cached_property
    def _spans(self) -> dict[str, tuple[int, int]]:
        return sample_spans(self._path, self._cache_dir)

    def __contains__(self, sample_token: str) -> bool:
        return sample_token in self._spans

    def table(self, sample_tokens: list[str]) -> DetectionTable | None:
        """Return the tracked classes' boxes of these samples; `frame` counts the samples.

        None if the file has none of the samples: no detector ran on them.

        Raises:
            DataError: the file is damaged, or lacks some of the samples.
        """
        if not self.holds(sample_tokens):
            return None
        parts = [self._boxes(i, token) for i, token in enumerate(sample_tokens)]
        return DetectionTable.stacked(parts)

    def holds(self, sample_tokens: list[str]) -> bool:
        """Return whether the file has the samples of a scene.

        Raises:
            DataError: it has some of them, not all.
        """
        present = [token in self for token in sample_tokens]
        if any(present) and not all(present):
            token = sample_tokens[present.index(False)]
            expected = "every sample of the scene, with [] where nothing was found"
            raise MissingError(self._path, f"results[{token}]", "missing", expected)
        return all(present)

    def _boxes(self, frame: int, token: str) -> DetectionTable:
        rows = self._rows(token)
        found = self._columns(token, rows)
        tracked = np.isin(found[self.NAME], _encoded(self._dialect.classes))
        table = DetectionTable(
            frame=np.full(len(rows), frame),
            label=found[self.NAME].astype(np.str_),
            score=found[self.SCORE],
            centre_m=found["translation"],
            size_m=found["size"][:, [1, 0, 2]],
            yaw_rad=wrap_angle(quaternion_yaws(found["rotation"])),
            velocity_mps=_velocities(found, rows),
        )
        return table.select(tracked)

    def _rows(self, token: str) -> list[Row]:
        start, end = self._spans[token]
        with opened(self._path) as file:
            file.seek(start)
            text = b"[" + file.read(end - start)
        rows = _first_value(text)
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            field = f"results[{token}]"
            raise TruncatedError(self._path, field, "not a list of boxes", "whole JSON")
        return rows

    def _columns(self, token: str, rows: list[Row]) -> Columns:
        """Return the fields of the boxes of a sample, checked."""

        def place(name: str, index: int) -> str:
            return f"results[{token}][{index}].{name}"

        fields = (*_FIELDS, ColumnSpec(self.NAME, str), ColumnSpec(self.SCORE))
        arrays = json_arrays(self._path, rows, fields, place)
        found = Columns(self._path, arrays, np.arange(len(rows)), place)
        found.refuse("sample_token", found["sample_token"] != token.encode(), token)
        check_sizes(found, "size")
        check_world_places(found)
        check_rotations(found, tolerance=QUATERNION_TOLERANCE)
        check_upright(found)
        known = np.isin(found[self.NAME], _encoded(self.known))
        found.refuse(self.NAME, ~known, f"one of {', '.join(self.known)}")
        return found


def _encoded(names: tuple[str, ...]) -> list[bytes]:
    return [name.encode() for name in names]


def _first_value(text: bytes) -> Any:
    """Return the JSON value that the text begins with, or None if it is damaged.

    orjson for speed where the text is the list and its comma; else the standard library, which
    also reads the NaN that some detectors write as velocity.
    """
    try:
        return orjson.loads(text.rstrip().removesuffix(b","))
    except orjson.JSONDecodeError:
        pass
    try:
        value, end = json.JSONDecoder().raw_decode(text.decode())
    except (ValueError, RecursionError):
        return None
    rest = text.decode()[end:].strip()
    return value if rest[:1] in (",", "}") else None


def _velocities(found: Columns, rows: list[Row]) -> F64:
    """Return (N, 2), NaN where a box has no usable velocity."""
    given = [row.get("velocity") for row in rows]
    missing = np.array([value is None for value in given], dtype=bool)
    velocity = np.full((len(rows), 2), np.nan)
    for index in np.flatnonzero(~missing):
        value = given[index]
        if value is None or not _is_pair(value):
            place = found.place("velocity", index)
            raise DataError(found.path, place, value, "2 numbers, or null where not known")
        velocity[index] = [np.nan if number is None else number for number in value]
    velocity[~(np.abs(velocity).max(axis=1, initial=0.0) < MAX_SPEED_MPS)] = np.nan
    return velocity


def _is_pair(value: object) -> bool:
    """Return whether a value is two numbers; orjson writes None for NaN."""
    return (
        isinstance(value, list)
        and len(value) == 2
        and all(
            number is None or (isinstance(number, int | float) and not isinstance(number, bool))
            for number in value
        )
    )


def sample_spans(path: Path, cache_dir: Path | None) -> dict[str, tuple[int, int]]:
    """Return where each sample's boxes are: `file[start:end]` by sample token.

    The text begins behind the opening bracket of the list and runs to the next sample's name or
    the file's end. The index of a large file is kept in `cache_dir`.

    Raises:
        DataError: missing file, no results, a cut end, or a sample that comes twice.
    """
    if not path.is_file():
        found = "not a file" if present(path) else "missing"
        raise MissingError(path, "file", found, "a detection file")
    index = _index(path, cache_dir)
    names = [token.decode(errors="replace") for token in index["token"].tolist()]
    spans = zip(index["start"].tolist(), index["end"].tolist(), strict=True)
    return dict(zip(names, spans, strict=True))


def _index(path: Path, cache_dir: Path | None) -> dict[str, NDArray[Any]]:
    if cache_dir is None or not is_large([path]):
        return _scan(path)
    entry = cache_dir / f"detections-{cache_key([path])}.npz"
    try:
        return read_arrays(entry)
    except ResultError:
        index = _scan(path)
    with suppress(OSError):  # a cache that can't be written is done without
        write_arrays(entry, index)
    return index


def _scan(path: Path) -> dict[str, NDArray[Any]]:
    """Return `token`, `start` and `end` (N,) of the lists of N samples."""
    if not path.stat().st_size:
        raise TruncatedError(path, "size in bytes", 0, "a detection file")
    with opened(path) as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
        _check_envelope(path, text)
        first = _FIRST.search(text)
        if first is None and not _EMPTY.search(text):
            raise DataError(path, "results", "no list first", "{sample_token: [box, ...], ...}")
        found = [first, *_NEXT.finditer(text, first.end())] if first else []
        token = [match.group(1) for match in found]
        start = [match.end() for match in found]
        end = [match.start(1) - 1 for match in found[1:]] + [len(text)] * bool(found)
    index = {
        "token": np.array(token, dtype=np.bytes_),
        "start": np.array(start, dtype=np.int64),
        "end": np.array(end, dtype=np.int64),
    }
    rows = Columns(path, index, index["token"], lambda _, token: f"results[{token.decode()}]")
    rows.refuse_repeated("token", index["token"], "each sample once")
    return index


def _check_envelope(path: Path, text: mmap.mmap) -> None:
    """Refuse a file without results, or without the two braces that close them and the whole."""
    if not _RESULTS.search(text):
        raise DataError(path, "results", "missing", "results: {sample_token: [box, ...], ...}")
    end = b"".join(text[-_END_BYTES:].split())
    if not end.endswith(b"}}"):
        raise TruncatedError(path, "end of file", end[-20:], "two closing braces")

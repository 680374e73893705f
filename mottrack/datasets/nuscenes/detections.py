"""Detection files in the official format, from any detector.

`{"meta": {...}, "results": {sample_token: [box, ...], ...}}` with boxes in the world frame. The
files of a whole split have up to a gigabyte, so only the places of the samples are found, and the
boxes of a sample are parsed when they are asked for.
"""

from __future__ import annotations

import json
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import orjson
from numpy.typing import NDArray

from mottrack.core.arrays import F64, Mask
from mottrack.core.errors import DataError
from mottrack.datasets.faults import MissingError, TruncatedError
from mottrack.datasets.files import MAX_BOX_SIZE_M
from mottrack.datasets.nuscenes.columns import Kind
from mottrack.datasets.nuscenes.config import CLASSES, DETECTION_NAMES
from mottrack.datasets.nuscenes.detection_index import indexed
from mottrack.datasets.nuscenes.truth import yaw_of
from mottrack.datasets.rigid import MAX_PLACE_M, quaternion_length
from mottrack.datasets.tables import DetectionTable

MAX_SPEED_MPS = 200.0
"""A faster object is none: its velocity is left out."""
_KINDS = (
    Kind("sample_token", text=True),
    Kind("translation", 3),
    Kind("size", 3),
    Kind("rotation", 4),
    Kind("detection_name", text=True),
    Kind("detection_score"),
)


class DetectionFile:
    """The boxes of each sample of a detection file."""

    def __init__(self, path: Path, cache_dir: Path | None = None) -> None:
        self._path, self._cache_dir = path, cache_dir

    @property
    def path(self) -> Path:
        """The file itself."""
        return self._path

    @cached_property
    def _spans(self) -> dict[str, tuple[int, int]]:
        return indexed(self._path, self._cache_dir).spans()

    def __contains__(self, sample_token: str) -> bool:
        return sample_token in self._spans

    def table(self, sample_tokens: list[str]) -> DetectionTable | None:
        """Return the tracked classes' boxes of these samples; `frame` counts the samples.

        None if the file has none of the samples: no detector ran on them.

        Raises:
            DataError: the file is damaged, or lacks some of the samples.

        """
        present = [token in self for token in sample_tokens]
        if not any(present):
            return None
        if not all(present):
            token = sample_tokens[present.index(False)]
            expected = "every sample of the scene, with [] where nothing was found"
            raise MissingError(self._path, f"results[{token}]", "missing", expected)
        parts = [self._boxes(i, token) for i, token in enumerate(sample_tokens)]
        return DetectionTable.stacked(parts)

    def _boxes(self, frame: int, token: str) -> DetectionTable:
        rows = self._rows(token)
        where = f"results[{token}]"
        columns = {kind.name: self._column(where, rows, kind) for kind in _KINDS}
        self._check(where, token, columns)
        tracked = np.isin(columns["detection_name"], [name.encode() for name in CLASSES])
        table = DetectionTable(
            frame=np.full(len(rows), frame),
            label=columns["detection_name"].astype(np.str_),
            score=columns["detection_score"],
            centre_m=columns["translation"],
            size_m=columns["size"][:, [1, 0, 2]],
            yaw_rad=yaw_of(columns["rotation"]),
            velocity_mps=_velocities(rows),
        )
        return table.select(tracked)

    def _rows(self, token: str) -> list[dict[str, Any]]:
        start, end = self._spans[token]
        with self._path.open("rb") as file:
            file.seek(start)
            text = b"[" + file.read(end - start)
        rows = _first_value(text)
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            raise TruncatedError(
                self._path, f"results[{token}]", "not a list of boxes", "whole JSON"
            )
        return rows

    def _column(self, where: str, rows: list[dict[str, Any]], kind: Kind) -> NDArray[Any]:
        values = [row.get(kind.name) for row in rows]
        array = kind.array(values) if values else kind.empty()
        if array is None:
            bad = next(i for i, value in enumerate(values) if kind.array([value]) is None)
            raise DataError(self._path, f"{where}[{bad}].{kind.name}", values[bad], kind.expected)
        return array

    def _check(self, where: str, token: str, columns: dict[str, NDArray[Any]]) -> None:
        unit = np.abs(quaternion_length(columns["rotation"]) - 1.0) < 1e-2
        known = np.isin(columns["detection_name"], [name.encode() for name in DETECTION_NAMES])
        checks = (
            ("sample_token", columns["sample_token"] == token.encode(), token),
            ("size", _in_size(columns["size"]), f"three numbers in (0, {MAX_BOX_SIZE_M:g}] m"),
            ("translation", _near(columns["translation"]), f"within {MAX_PLACE_M:g} m"),
            ("rotation", unit, "a unit quaternion"),
            ("detection_name", known, f"one of {', '.join(DETECTION_NAMES)}"),
        )
        for name, good, expected in checks:
            if not good.all():
                bad = int(np.flatnonzero(~good)[0])
                value = columns[name][bad].tolist()
                shown = value.decode() if isinstance(value, bytes) else value
                raise DataError(self._path, f"{where}[{bad}].{name}", shown, expected)


def _in_size(size_m: F64) -> Mask:
    return np.asarray(((size_m > 0.0) & (size_m <= MAX_BOX_SIZE_M)).all(axis=1))


def _near(centre_m: F64) -> Mask:
    return np.asarray((np.abs(centre_m) <= MAX_PLACE_M).all(axis=1))


def _first_value(text: bytes) -> Any:
    """The JSON value that the text begins with, or None if it is damaged.

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


def _velocities(rows: list[dict[str, Any]]) -> F64:
    """(N, 2), NaN where a box has no usable velocity."""
    velocity = np.full((len(rows), 2), np.nan)
    kind = Kind("velocity", 2)
    for index, row in enumerate(rows):
        values = kind.array([row.get("velocity")])
        if values is not None and np.abs(values[0]).max() < MAX_SPEED_MPS:
            velocity[index] = values[0]
    return velocity

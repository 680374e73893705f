"""Point clouds in PCD files, the format of the Point Cloud Library: binary, compressed or not."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mottrack.compiled import compiled
from mottrack.core.errors import DataError
from mottrack.core.limits import MAX_ARRAY_BYTES, MAX_POINTS
from mottrack.core.storage import write_bytes
from mottrack.formats.checks import check_count
from mottrack.formats.faults import TruncatedError
from mottrack.formats.files import read_bytes

MAX_HEADER_BYTES = 4096
"""A header has eleven lines; one of fifty fields has 2 kB."""
_KINDS = {"F": "f", "U": "u", "I": "i"}
"""PCD's letter of a type to numpy's."""
_PACKED_SIZES = struct.Struct("<II")
"""Bytes of compressed data before and after unpacking."""
_SIZES = ("1", "2", "4", "8")


class _Header(NamedTuple):
    """What the text before the data says: the fields in order, their number of points."""

    names: list[str]
    kinds: list[str]
    points: int
    encoding: str
    end: int
    """Where the data begins."""


def read_pcd(path: Path, names: tuple[str, ...], optional: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return fields of a PCD file as arrays (N,) by name.

    Args:
        path: the file.
        names: fields that it must have.
        optional: fields that are returned where it has them.

    Raises:
        DataError: missing or damaged file, a field that is not there, or data as text.
    """
    data = read_bytes(path)
    header = _header(path, data)
    for name in names:
        if name not in header.names:
            raise DataError(path, "FIELDS", " ".join(header.names), " ".join(names))
    dtype = np.dtype(list(zip(header.names, header.kinds, strict=True)))
    content = _content(path, data, header, dtype.itemsize * header.points)
    if header.encoding == "binary":
        rows = np.frombuffer(content, dtype, header.points)
        fields = {name: rows[name] for name in header.names}
    else:
        fields = _columns(content, header)
    return {name: fields[name] for name in (*names, *optional) if name in fields}


def write_pcd(path: Path, columns: dict[str, NDArray[Any]]) -> None:
    """Write columns (N,) of 4 or 8 bytes a value as an uncompressed binary PCD file."""
    dtype = np.dtype([(name, values.dtype.newbyteorder("<")) for name, values in columns.items()])
    rows = np.empty(len(next(iter(columns.values()))), dtype)
    for name, values in columns.items():
        rows[name] = values
    letters = {value: key for key, value in _KINDS.items()}
    lines = [
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        f"FIELDS {' '.join(columns)}",
        f"SIZE {' '.join(str(v.dtype.itemsize) for v in columns.values())}",
        f"TYPE {' '.join(letters[v.dtype.kind] for v in columns.values())}",
        f"COUNT {' '.join('1' for _ in columns)}",
        f"WIDTH {len(rows)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(rows)}",
        "DATA binary",
    ]
    write_bytes(path, ("\n".join(lines) + "\n").encode() + rows.tobytes())


def _header(path: Path, data: bytes) -> _Header:
    lines: dict[str, list[str]] = {}
    place = 0
    while "DATA" not in lines:
        end = data.find(b"\n", place, MAX_HEADER_BYTES)
        if end < 0:
            raise TruncatedError(path, "header", "without its end", "a line DATA binary")
        words = data[place:end].decode("ascii", "replace").split()
        place = end + 1
        if words and not words[0].startswith("#"):
            lines[words[0]] = words[1:]
    names, sizes, types = (lines.get(key, []) for key in ("FIELDS", "SIZE", "TYPE"))
    counts = lines.get("COUNT", ["1"] * len(names))
    whole = names and len(names) == len(sizes) == len(types) == len(counts)
    known = set(types) <= set(_KINDS) and set(sizes) <= set(_SIZES) and set(counts) == {"1"}
    if not (whole and known and len(set(names)) == len(names)):
        found = f"{names} {sizes} {types} {counts}"
        raise DataError(path, "fields", found, "names with a size, a type F, U or I and count 1")
    points = (lines.get("POINTS") or lines.get("WIDTH") or [""])[0]
    if not (points.isascii() and points.isdigit() and len(points) < 12):
        raise DataError(path, "POINTS", points, "a number of points")
    check_count(path, int(points), MAX_POINTS)
    encoding = (lines["DATA"] or [""])[0]
    if encoding not in ("binary", "binary_compressed"):
        raise DataError(path, "DATA", encoding, "binary or binary_compressed")
    kinds = [f"<{_KINDS[t]}{s}" for t, s in zip(types, sizes, strict=True)]
    if "<f1" in kinds:
        raise DataError(path, "SIZE", sizes, "2, 4 or 8 bytes of a number of type F")
    return _Header(names, kinds, int(points), encoding, place)


def _content(path: Path, data: bytes, header: _Header, wanted: int) -> bytes | memoryview:
    """Return the data of all points, unpacked."""
    rest = memoryview(data)[header.end :]
    if header.encoding == "binary":
        if len(rest) < wanted:
            raise TruncatedError(path, "point data", f"{len(rest)} bytes", str(wanted))
        return rest
    if len(rest) < _PACKED_SIZES.size:
        raise TruncatedError(path, "point data", f"{len(rest)} bytes", "two sizes first")
    packed, size = _PACKED_SIZES.unpack_from(rest)
    if size != wanted or size > MAX_ARRAY_BYTES.value:
        raise DataError(path, "bytes unpacked", size, f"{wanted}, those of the points")
    source = np.frombuffer(rest, np.uint8, offset=_PACKED_SIZES.size)
    if len(source) < packed:
        raise TruncatedError(path, "point data", f"{len(source)} bytes", str(packed))
    target = np.empty(size, np.uint8)
    if _unpack(source[:packed], target) != size:
        raise DataError(path, "point data", "not LZF", f"{size} bytes packed")
    return target.tobytes()


def _columns(content: bytes | memoryview, header: _Header) -> dict[str, NDArray[Any]]:
    """Return the fields of unpacked data, in which they stand one after the other."""
    fields, place = {}, 0
    for name, kind in zip(header.names, header.kinds, strict=True):
        fields[name] = np.frombuffer(content, kind, header.points, place)
        place += fields[name].nbytes
    return fields


class _Place(NamedTuple):
    """Where unpacking is: the next byte of the source, the next of the target; -1: damaged."""

    source: int
    target: int


@compiled
def _unpack(source: NDArray[np.uint8], target: NDArray[np.uint8]) -> int:
    """Unpack LZF (M. Lehmann's liblzf): runs of bytes, and copies of what came before.

    Return the number of bytes written, -1 where the data is damaged.
    """
    place = _Place(0, 0)
    while place.target >= 0 and place.source < len(source):
        if source[place.source] < 32:
            place = _run(source, target, place)
        else:
            place = _copy(source, target, place)
    return place.target


@compiled
def _run(source: NDArray[np.uint8], target: NDArray[np.uint8], place: _Place) -> _Place:
    """Take bytes as they are: their number less one, then the bytes."""
    length = int(source[place.source]) + 1
    start = place.source + 1
    if start + length > len(source) or place.target + length > len(target):
        return _Place(0, -1)
    for k in range(length):
        target[place.target + k] = source[start + k]
    return _Place(start + length, place.target + length)


@compiled
def _copy(source: NDArray[np.uint8], target: NDArray[np.uint8], place: _Place) -> _Place:
    """Repeat what came before: three bits of its length, 13 of how far back it is."""
    control, i = int(source[place.source]), place.source + 1
    length = control >> 5
    if length == 7 and i < len(source):
        length += int(source[i])
        i += 1
    if i >= len(source):
        return _Place(0, -1)
    start = place.target - ((control & 31) << 8) - int(source[i]) - 1
    length += 2
    if start < 0 or place.target + length > len(target):
        return _Place(0, -1)
    for k in range(length):  # byte by byte: a copy may overlap itself
        target[place.target + k] = target[start + k]
    return _Place(i + 1, place.target + length)

"""Where the boxes of each sample are in a detection file."""

from __future__ import annotations

import mmap
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import I64
from mottrack.core.errors import DataError, ResultError
from mottrack.core.storage import read_arrays, write_arrays
from mottrack.datasets.faults import MissingError, OutOfOrderError, TruncatedError
from mottrack.datasets.nuscenes.cache import cache_key, is_large

_RESULTS = re.compile(rb'"results"\s*:\s*\{')
_LIST = rb'"([^"\\]+)"\s*:\s*\[\s*(?=[{\]])'
_EMPTY = re.compile(rb'"results"\s*:\s*\{\s*\}')
_FIRST = re.compile(rb'"results"\s*:\s*\{\s*' + _LIST)
# to look for the bracket that ends a list is five times as fast as for a quotation mark
_NEXT = re.compile(rb"\]\s*,\s*" + _LIST)
_END_BYTES = 256


@dataclass(frozen=True)
class DetectionIndex:
    """The lists of N samples: text of sample i is `file[start[i]:end[i]]`.

    It begins behind the opening bracket and runs to the next sample's name or the file's end.
    """

    token: NDArray[np.bytes_]
    start: I64
    end: I64

    def spans(self) -> dict[str, tuple[int, int]]:
        """Start and end by sample token."""
        names = [token.decode(errors="replace") for token in self.token.tolist()]
        return dict(
            zip(names, zip(self.start.tolist(), self.end.tolist(), strict=True), strict=True)
        )


def indexed(path: Path, cache_dir: Path | None) -> DetectionIndex:
    """Return the index of a file; that of a large one is kept in `cache_dir`.

    Raises:
        DataError: missing file, no results, a cut end, or a sample that comes twice.
    """
    if not path.is_file():
        raise MissingError(path, "file", "missing", "a detection file")
    if cache_dir is None or not is_large([path]):
        return _scan(path)
    entry = cache_dir / f"detections-{cache_key([path])}.npz"
    try:
        arrays: dict[str, NDArray[Any]] = read_arrays(entry)
        return DetectionIndex(**arrays)
    except ResultError:
        index = _scan(path)
    try:
        write_arrays(entry, {"token": index.token, "start": index.start, "end": index.end})
    except OSError:
        return index  # a cache that can't be written is done without
    return index


def _scan(path: Path) -> DetectionIndex:
    if not path.stat().st_size:
        raise TruncatedError(path, "size in bytes", 0, "a detection file")
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
        _check_envelope(path, text)
        first = _FIRST.search(text)
        if first is None and not _EMPTY.search(text):
            raise DataError(path, "results", "no list first", "{sample_token: [box, ...], ...}")
        found = [first, *_NEXT.finditer(text, first.end())] if first else []
        token = [match.group(1) for match in found]
        start = [match.end() for match in found]
        end = [match.start(1) - 1 for match in found[1:]] + [len(text)] * bool(found)
    if len(set(token)) != len(token):
        repeated = next(name for i, name in enumerate(token) if name in token[:i])
        field = f"results[{repeated.decode(errors='replace')}]"
        raise OutOfOrderError(path, field, "repeated", "each sample once")
    return DetectionIndex(
        np.array(token, dtype=np.bytes_),
        np.array(start, dtype=np.int64),
        np.array(end, dtype=np.int64),
    )


def _check_envelope(path: Path, text: mmap.mmap) -> None:
    """There are results, and the file ends with the two braces that close them and the whole."""
    if not _RESULTS.search(text):
        raise DataError(path, "results", "missing", "results: {sample_token: [box, ...], ...}")
    end = b"".join(text[-_END_BYTES:].split())
    if not end.endswith(b"}}"):
        raise TruncatedError(path, "end of file", end[-20:], "two closing braces")

"""Atomic file replacement, and arrays with a checksum."""

from __future__ import annotations

import hashlib
import io
import os
import tempfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from mottrack.core.errors import ResultError
from mottrack.core.npz import unpacked_npz

UNFINISHED = ".part"
FORMAT_KEY = "format"  # name of the array that says what a file holds
CHECKSUM_BYTES = hashlib.sha256().digest_size


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file through a temporary one beside it: a reader sees the old or the new."""
    try:
        _replace(path, data)
    except OSError as error:
        if error.filename is not None:
            raise
        # a full disk is reported by a number alone
        raise type(error)(error.errno, error.strerror, str(path)) from error


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write contents by path within a folder, in that order."""
    for name, data in files.items():
        write_bytes(folder / name, data)


def _replace(path: Path, data: bytes) -> None:
    with atomic_file(path) as file:
        file.write(data)


@contextmanager
def atomic_file(path: Path) -> Iterator[BinaryIO]:
    """Open a file to be written piece by piece; it takes its name when all is written."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(
        dir=path.parent, prefix=f".{path.name}.", suffix=UNFINISHED
    )
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).chmod(0o644)  # mkstemp makes files that only their owner can read
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def discard_unfinished(folder: Path) -> None:
    """Remove the temporary files of writers that were killed."""
    for temporary in folder.glob(f".*{UNFINISHED}"):
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a UTF-8 text file atomically."""
    write_bytes(path, utf8(text))


def utf8(text: str) -> bytes:
    """Return a text's UTF-8 bytes, whatever the locale it came from.

    Arguments and file names that the locale's encoding does not take hold their bytes as lone
    surrogates: those that are UTF-8 become what was meant, others are replaced.
    """
    try:
        return text.encode()
    except UnicodeEncodeError:
        raw = text.encode("utf-8", "surrogateescape" if _escaped(text) else "replace")
        return raw.decode("utf-8", "replace").encode()


def _escaped(text: str) -> bool:
    """Return whether every lone surrogate stands for a byte."""
    return all(not "\ud800" <= c <= "\udfff" or "\udc80" <= c <= "\udcff" for c in text)


class StoredArrays(dict[str, NDArray[Any]]):
    """The arrays of one file by name; one that is absent raises a `ResultError`."""

    def __init__(self, path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
        super().__init__(arrays)
        self.path = path

    def __missing__(self, name: str) -> NDArray[Any]:
        raise ResultError(self.path, "content", f"without {name!r}", "every array")


def write_arrays(
    path: Path, arrays: Mapping[str, NDArray[Any]], file_format: str | None = None
) -> None:
    """Write named arrays as a compressed npz, followed by the SHA-256 of its bytes.

    The same arrays give the same bytes; ``numpy.load`` opens the file as well.

    Args:
        path: of the file, which is replaced atomically.
        arrays: by name.
        file_format: name and version of what the file holds, for `read_arrays` to compare.
    """
    buffer = io.BytesIO()
    named = {} if file_format is None else {FORMAT_KEY: np.array(file_format)}
    np.savez_compressed(buffer, **named, **arrays)  # type: ignore[arg-type]
    data = buffer.getvalue()
    write_bytes(path, data + hashlib.sha256(data).digest())


def read_arrays(
    path: Path, file_format: str | None = None, wanted: Collection[str] | None = None
) -> StoredArrays:
    """Read what ``write_arrays`` wrote, or the arrays of the wanted names; never unpickle.

    Raises:
        ResultError: the file is missing, a single bit of it has changed, or its format is another.
    """
    try:
        whole = path.read_bytes()
    except OSError as error:
        raise ResultError(path, "file", error.strerror, "a stored result") from error
    data, stored = whole[:-CHECKSUM_BYTES], whole[-CHECKSUM_BYTES:]
    actual = hashlib.sha256(data).digest()
    if stored != actual:
        raise ResultError(path, "checksum", stored.hex()[:12], f"{actual.hex()[:12]} (damaged?)")
    try:
        arrays = StoredArrays(path, unpacked_npz(data, wanted and {FORMAT_KEY, *wanted}))
    except ValueError as error:
        raise ResultError(path, "content", error, "arrays of mottrack") from error
    if file_format is not None and str(arrays.get(FORMAT_KEY)) != file_format:
        raise ResultError(path, FORMAT_KEY, arrays.get(FORMAT_KEY), file_format)
    return arrays

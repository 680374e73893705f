"""Arrays of npy and npz files that a stranger wrote: nothing is unpickled, nothing is huge."""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from collections.abc import Collection
from tokenize import TokenError
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from mottrack.core.limits import MAX_ARRAY_BYTES

_SUFFIX = ".npy"
# what zipfile, zlib and numpy raise on damaged bytes, encrypted or otherwise packed members
_FAULTS = (
    zipfile.BadZipFile,
    zlib.error,
    OSError,
    EOFError,
    RuntimeError,  # encrypted, NotImplementedError of other compressions
    KeyError,
    TypeError,
    SyntaxError,
    MemoryError,
    OverflowError,
    AttributeError,
    IndexError,
    TokenError,  # numpy reads the header with the parser of Python's own literals
)


def unpacked_npz(data: bytes, wanted: Collection[str] | None = None) -> dict[str, NDArray[Any]]:
    """Return the arrays of an npz file, those of the wanted names.

    Raises:
        ValueError: it is none, damaged, or an array is larger than `MAX_ARRAY_BYTES`.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            names = archive.namelist()
            if len(set(names)) != len(names):
                raise ValueError("unreadable (a name twice)")
            return {
                name.removesuffix(_SUFFIX): _member(archive, name)
                for name in names
                if wanted is None or name.removesuffix(_SUFFIX) in wanted
            }
    except _FAULTS as error:
        raise ValueError(f"unreadable ({_reason(error)})") from error


def unpacked_npy(data: bytes) -> NDArray[Any]:
    """Return the array of an npy file.

    Raises:
        ValueError: it is none, damaged, or larger than `MAX_ARRAY_BYTES`.
    """
    try:
        return _array(io.BytesIO(data), len(data))
    except _FAULTS as error:
        raise ValueError(f"unreadable ({_reason(error)})") from error


def _member(archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    size = archive.getinfo(name).file_size
    with archive.open(name) as file:
        array = _array(file, size)
        file.read(1)  # at its end zipfile compares the checksum
    return array


def _array(file: IO[bytes], size: int) -> NDArray[Any]:
    """Read an array whose header agrees with the `size` bytes that the file has."""
    version = npy.read_magic(file)
    readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    if version not in readers:
        raise ValueError(f"npy of version {version}")
    shape, fortran, dtype = readers[version](file)
    if dtype.hasobject:
        raise ValueError("Python objects instead of numbers or text")
    count = math.prod(shape)
    if min(shape, default=0) < 0 or count * dtype.itemsize > size:
        raise ValueError(f"an array {shape} of {dtype} in {size} bytes")
    if count * dtype.itemsize > MAX_ARRAY_BYTES.value:
        raise ValueError(f"an array {shape} of {dtype}: {MAX_ARRAY_BYTES.expected('bytes')}")
    data = file.read(count * dtype.itemsize)
    if len(data) != count * dtype.itemsize:
        raise ValueError("ends before its content does")
    array = np.frombuffer(bytearray(data), dtype=dtype, count=count) if data else np.zeros(0, dtype)
    return array.reshape(shape, order="F" if fortran else "C")


def _reason(error: BaseException) -> str:
    text = str(error).splitlines()
    return text[0] if text else type(error).__name__

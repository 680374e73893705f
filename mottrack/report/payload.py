"""Numbers inside a page: arrays packed, compressed and written as text.

    4 bytes   length of the header, little endian
    header    JSON, padded with spaces to a multiple of 8 bytes:
              {"arrays": {name: [type, first byte, count]}, ...whatever else}
    arrays    little endian, each from a multiple of 8 bytes on

The whole is compressed (gzip) and written in base64; film_data.js reads it.
"""

from __future__ import annotations

import base64
import gzip
import json
from typing import Any

from numpy.typing import NDArray

TYPES = {"|i1", "|u1", "<i2", "<u2", "<i4", "<u4", "<f8"}
"""What a browser has typed arrays for."""
LEVEL = 9
ALIGNMENT = 8


def pack(header: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> str:
    """The header (JSON) and the arrays as base64 text; the same content gives the same text.

    Raises:
        TypeError: an array has a type that a browser has no typed array for.
    """
    body = bytearray()
    places: dict[str, list[Any]] = {}
    for name, array in arrays.items():
        kind = array.dtype.newbyteorder("<").str
        if kind not in TYPES:
            raise TypeError(f"array '{name}' is {kind}, expected one of {sorted(TYPES)}")
        places[name] = [kind[1:], len(body), array.size]
        body += _padded(array.astype(kind).tobytes(), b"\0")
    text = json.dumps({**header, "arrays": places}, separators=(",", ":"), allow_nan=False)
    length = len(text.encode()).to_bytes(4, "little")
    whole = _padded(length + text.encode(), b" ") + bytes(body)
    return base64.b64encode(gzip.compress(whole, LEVEL, mtime=0)).decode()


def _padded(data: bytes, filler: bytes) -> bytes:
    return data + filler * (-len(data) % ALIGNMENT)

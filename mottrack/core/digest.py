"""Digests of values by their content: arrays, and classes that hold arrays."""

from __future__ import annotations

import hashlib
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


def digest_of(*values: Any) -> bytes:
    """Return the SHA-256 of plain values, arrays, and data classes and sequences of them.

    Raises:
        TypeError: a value is of another type.
    """
    digest = hashlib.sha256()
    for value in values:
        _add(digest, value)
    return digest.digest()


def _add(digest: Any, value: Any) -> None:
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype.str}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value).data)
    elif is_dataclass(value) and not isinstance(value, type):
        digest.update(type(value).__qualname__.encode())
        for item in fields(value):
            _add(digest, getattr(value, item.name))
    elif isinstance(value, tuple | list):
        digest.update(f"{len(value)}".encode())
        for item in value:
            _add(digest, item)
    elif value is None or isinstance(value, str | bytes | int | float | np.generic):
        digest.update(f"{type(value).__name__}{value!r};".encode())
    else:
        raise TypeError(f"no digest of a {type(value).__name__}")

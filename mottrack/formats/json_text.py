"""JSON that a stranger wrote: damaged, too deep, with numbers that no type holds."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import orjson

from mottrack.core.errors import DataError

MAX_DEPTH = 100
"""Nested deeper is no file of ours or of a data set: those have six levels at most."""
_BRACKETS = re.compile(rb'"(?:[^"\\]|\\.)*"|[\[{\]}]')


def parse_json(path: Path, data: bytes, expected: str = "a JSON file") -> Any:
    """Return the value of a JSON text; NaN and Infinity, which Python writes, are taken.

    Raises:
        DataError: it is damaged, or nested deeper than `MAX_DEPTH`.
    """
    try:
        return orjson.loads(data)
    except orjson.JSONDecodeError as error:
        return _slow(path, data, expected, error)


def _slow(path: Path, data: bytes, expected: str, first: orjson.JSONDecodeError) -> Any:
    """Parse what the fast parser refused."""
    if not (b"NaN" in data or b"Infinity" in data):
        raise DataError(path, "JSON", _where(first), expected) from first
    if _deeper_than(data, MAX_DEPTH):
        raise DataError(
            path, "JSON", f"unreadable (nested deeper than {MAX_DEPTH})", expected
        ) from first
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        reason = f"unreadable ({str(error) or 'nested too deep'})"
        raise DataError(path, "JSON", reason, expected) from error


def _where(error: orjson.JSONDecodeError) -> str:
    return f"unreadable ({error.msg.rstrip('.')}; line {error.lineno}, column {error.colno})"


def _deeper_than(data: bytes, most: int) -> bool:
    depth = 0
    for found in _BRACKETS.finditer(data):
        mark = found.group()
        depth += (mark in (b"[", b"{")) - (mark in (b"]", b"}"))
        if depth > most:
            return True
    return False

"""Where an index of large files is kept on disk: scanning gigabytes of JSON once is enough.

An entry is named by the files it was made from (path, size, time of change) and by the layout of
the entry, so that a changed file is never answered from an old entry; each holds a checksum, and a
damaged one is made again.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

LAYOUT = "3"
"""Version of the entries' content: raise it when the arrays that are stored change."""
LARGE_BYTES = 64 * 2**20
"""64 MiB of JSON are parsed in less than a second; an index of less saves nothing."""


def cache_folder(chosen: Path | None = None) -> Path:
    """Return the chosen folder, else `$MOTTRACK_CACHE`, else the user's own."""
    if chosen is not None:
        return chosen
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(os.environ.get("MOTTRACK_CACHE") or Path(base) / "mottrack")


def cache_key(paths: list[Path]) -> str:
    """Return a name for what is made from these files."""
    digest = hashlib.sha256(LAYOUT.encode())
    for path in paths:
        stat = path.stat()
        digest.update(f"|{path.resolve()}|{stat.st_size}|{stat.st_mtime_ns}".encode())
    return digest.hexdigest()[:24]


def is_large(paths: list[Path]) -> bool:
    """Return whether reading these files takes noticeable time."""
    return sum(path.stat().st_size for path in paths) > LARGE_BYTES

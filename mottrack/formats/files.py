"""Paths that stay inside the root of a data set, and checked reading of whole files."""

from __future__ import annotations

from pathlib import Path

from mottrack.core.errors import DataError
from mottrack.formats.faults import MissingError, OutsideRootError


def inside(root: Path, relative: str, *, follow_links: bool = False) -> Path:
    """Return `root / relative`; refuse a name that leaves the root.

    Names come from the files of a data set, so they are not trusted: absolute names and `..` are
    refused, and so are links that point outside unless `follow_links` says that they are the
    user's own (data sets are often spread over several disks that way).

    Raises:
        DataError: the path escapes the root.
    """
    path = root / relative
    plain = not Path(relative).is_absolute() and ".." not in Path(relative).parts
    if not plain or "\0" in relative:
        raise OutsideRootError(root, "path", relative, "a path inside the data root")
    if not follow_links and not path.resolve().is_relative_to(root.resolve()):
        raise OutsideRootError(path, "link", str(path.resolve()), "a target inside the data root")
    return path


def existing_folder(path: Path, field: str) -> Path:
    """Return `path` if it is a folder that is not empty, else raise `DataError`."""
    if not path.is_dir():
        raise MissingError(path, field, "missing", "a folder")
    if next(path.iterdir(), None) is None:
        raise MissingError(path, field, "empty folder", "a folder with data")
    return path


def read_bytes(path: Path) -> bytes:
    """Return the bytes of a file; an unreadable or missing one is a `DataError`."""
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        raise MissingError(path, "file", "missing", "a readable file") from error
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise DataError(path, "file", f"unreadable ({reason})", "a readable file") from error


def read_text(path: Path) -> str:
    """Return a UTF-8 text file without its byte order mark; other bytes are a `DataError`."""
    try:
        return read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(path, "byte", error.start, "UTF-8 text") from error

"""Paths that stay inside the root of a data set, and checked reading of whole files."""

from __future__ import annotations

import os
import re
from pathlib import Path

from mottrack.core.errors import DataError
from mottrack.core.limits import MAX_TEXT_BYTES
from mottrack.formats.faults import MissingError, OutsideRootError

NAME_MAX, PATH_MAX = 255, 4095
"""Bytes of a name and of a path, as Linux has them."""
_UTF16 = (b"\xff\xfe", b"\xfe\xff")
_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029]")
"""All but the tabulator and the line feed; the last two are line ends to some programs."""


def inside(root: Path, relative: str, *, follow_links: bool = False) -> Path:
    """Return `root / relative`; refuse a name that leaves the root.

    Names come from the files of a data set, so they are not trusted: absolute names and `..` are
    refused, and so are links that point outside unless `follow_links` says that they are the
    user's own (data sets are often spread over several disks that way).

    Raises:
        DataError: the path escapes the root.
    """
    _require_possible_name(root, relative)
    path = root / relative
    plain = not Path(relative).is_absolute() and ".." not in Path(relative).parts
    if not plain:
        raise OutsideRootError(root, "path", relative, "a path inside the data root")
    if not follow_links and not path.resolve().is_relative_to(root.resolve()):
        raise OutsideRootError(path, "link", str(path.resolve()), "a target inside the data root")
    return path


def _require_possible_name(root: Path, relative: str) -> None:
    """Refuse what no file system takes: a NUL, half a surrogate pair, a part that is too long."""
    try:
        name = os.fsencode(relative)
    except UnicodeEncodeError as error:
        raise DataError(root, "path", relative, "text that is whole Unicode") from error
    longest = max(map(len, name.split(os.fsencode(os.sep))))
    if b"\0" in name or longest > NAME_MAX or len(name) > PATH_MAX:
        raise OutsideRootError(root, "path", relative, "a path inside the data root")


def present(path: Path) -> bool:
    """Return whether anything has this name: a folder or a broken link in a file's place is told.

    `Path.is_file` answers no to both, and an optional file would be passed over in silence.
    """
    return os.path.lexists(path)


def existing_folder(path: Path, field: str) -> Path:
    """Return `path` if it is a folder that is not empty, else raise `DataError`."""
    if not path.is_dir():
        found = "a file" if path.exists() else "missing"
        if not path.parent.exists():
            found = f"missing: {path.parent} does not exist"
        raise MissingError(path, field, found, "a folder")
    if next(path.iterdir(), None) is None:
        raise MissingError(path, field, "empty folder", "a folder with data")
    return path


def read_bytes(path: Path) -> bytes:
    """Return the bytes of a file; an unreadable or missing one is a `DataError`."""
    try:
        return path.read_bytes()
    except ValueError as error:  # a NUL or half a surrogate pair in the name
        raise DataError(path, "path", f"not a name ({error})", "a readable file") from error
    except FileNotFoundError as error:
        raise MissingError(path, "file", "missing", "a readable file") from error
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise DataError(path, "file", f"unreadable ({reason})", "a readable file") from error


def read_text(path: Path) -> str:
    """Return a UTF-8 text file without its byte order mark and with line feeds as line ends.

    Raises:
        DataError: it can't be read, is in another encoding, holds control characters, or is
            larger than `MAX_TEXT_BYTES`.
    """
    require_size(path, MAX_TEXT_BYTES.value, MAX_TEXT_BYTES.expected("bytes"))
    return decoded_text(path, read_bytes(path))


def decoded_text(path: Path, data: bytes) -> str:
    """Return the text of bytes that were read from a file; see `read_text`."""
    if data.startswith(_UTF16):
        raise DataError(path, "encoding", "UTF-16 by its byte order mark", "UTF-8 text")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        found = f"0x{data[error.start]:02x} at byte {error.start}"
        raise DataError(path, f"line {line}", found, "UTF-8 text") from error
    if "\r" in text:
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    odd = _CONTROL.search(text)
    if odd:
        line = text.count("\n", 0, odd.start()) + 1
        found = f"a control character U+{ord(odd.group()):04X}"
        raise DataError(path, f"line {line}", found, "plain text")
    return text


def require_size(path: Path, most_bytes: int, expected: str) -> None:
    """Raise `DataError` for a file of more bytes; one that is not there is left to the reader."""
    size = path.stat().st_size if path.is_file() else 0
    if size > most_bytes:
        raise DataError(path, "size in bytes", size, expected)

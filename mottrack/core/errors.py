"""Errors that a user can cause: one line that says where, what, and what was expected."""

from __future__ import annotations

import os
from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path

from mottrack.core.printed import MAX_MESSAGE, MAX_SHOWN, printable, shown

MAX_PATH_SHOWN = 300
"""Characters of a path in a message."""


class MottrackWarning(UserWarning):
    """Something a user should know that does not stop the work."""


class MottrackError(Exception):
    """Base of all errors that a user can cause. The command line prints it and exits with 2."""


class InputError(MottrackError, ValueError):
    """An array or argument handed over through the Python API is not usable."""

    def __init__(self, field: str, value: object, expected: str) -> None:
        super().__init__(field, value, expected)  # the arguments, so that it can be pickled
        self.field, self.value, self.expected = field, value, expected

    def __str__(self) -> str:
        return _sentence(self.field, self.value, self.expected)


class DataError(MottrackError):
    """A file of a data set, a submission or a result is not usable."""

    def __init__(self, file: str | Path, field: str, value: object, expected: str) -> None:
        super().__init__(file, field, value, expected)
        self.file, self.field, self.value, self.expected = Path(file), field, value, expected

    def __str__(self) -> str:
        sentence = _sentence(self.field, self.value, self.expected)
        return f"{shown(self.file, MAX_PATH_SHOWN)}: {sentence}"


class ConfigError(MottrackError):
    """A configuration, an override or the name of a part is not usable."""

    def __init__(self, message: str) -> None:
        super().__init__(printable(message, MAX_MESSAGE))


class ResultError(DataError):
    """A stored result is damaged or of another version."""


def _sentence(field: str, value: object, expected: str) -> str:
    return f"{shown(field)} is {shown(value)}, expected {printable(expected, MAX_MESSAGE)}"


def require_exists(path: Path, expected: str = "a file or folder") -> None:
    """Refuse a path of the command line at which there is nothing.

    Raises:
        ConfigError: it does not exist.
    """
    if not path.exists():
        raise ConfigError(f"{shown(path, MAX_PATH_SHOWN)} does not exist, expected {expected}")


def require_out_folder(path: Path) -> None:
    """Refuse a path at which no folder for results can be, before anything is computed.

    Raises:
        ConfigError: it is a file, lies below one, or nothing may be written there.
    """
    nearest = next((at for at in (path, *path.absolute().parents) if at.exists()), path)
    given, found = (shown(at, MAX_PATH_SHOWN) for at in (path, nearest))
    if not nearest.is_dir():
        raise ConfigError(f"--out is {given}, but {found} is a file, expected a folder")
    if not os.access(nearest, os.W_OK):
        raise ConfigError(f"--out is {given}, but {found} is read-only, expected a folder")


def no_such_file(kind: str, name: str, shipped: Iterable[str]) -> ConfigError:
    """Build the error for what is neither a file nor the name of one that is shipped.

    Args:
        kind: what was asked for, such as ``"config"``.
        name: a path, or a name.
        shipped: all names that would have been accepted.
    """
    if Path(name).suffix or Path(name).parent.name:
        expected = f"the YAML file of a {kind}, or the name of a shipped one"
        return ConfigError(f"{shown(name, MAX_PATH_SHOWN)} does not exist, expected {expected}")
    return unknown_name(kind, name, shipped)


def unknown_name(kind: str, name: str, valid: Iterable[str]) -> ConfigError:
    """Build the error for a name that is in no table; it lists the valid ones and the nearest.

    Args:
        kind: what was asked for, such as ``"flow source"``.
        name: the unknown name.
        valid: all names that would have been accepted.
    """
    return ConfigError(f"unknown {kind} '{shown(name)}'{did_you_mean(name, valid)}")


def did_you_mean(name: str, valid: Iterable[str]) -> str:
    """Return the end of an error message: the valid name nearest to ``name``, and all of them."""
    names = sorted(valid)
    # 0.5 instead of difflib's 0.6: short names such as "ipc" for "icp" still find their neighbour
    near = get_close_matches(name[:MAX_SHOWN], names, n=1, cutoff=0.5)
    hint = f" (did you mean '{near[0]}'?)" if near else ""
    return f"{hint}; valid: {', '.join(names)}"

"""Rows of numbers in text files (KITTI, MOTChallenge): every fault names the file and the line."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mottrack.core.errors import DataError


def read_lines(path: Path) -> list[str]:
    """Lines of a UTF-8 text file.

    Raises:
        DataError: the file can not be read, or is no text.
    """
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise DataError(path, "file", error.strerror, "a readable text file") from error
    except UnicodeDecodeError as error:
        raise DataError(path, "byte", error.start, "UTF-8 text") from error


def finite_numbers(path: Path, line: int, fields: Sequence[str]) -> list[float]:
    """The fields of a line as numbers, the first two of which, frame and identity, are whole.

    Raises:
        DataError: a field is no finite number, or the frame or the identity has a fraction.
    """
    try:
        numbers = [float(field) for field in fields]
    except ValueError as error:
        raise DataError(path, f"line {line}", str(error), "numbers") from error
    if not np.isfinite(numbers).all():
        raise DataError(path, f"line {line}", "NaN or infinity", "finite numbers")
    for name, number in zip(("frame", "id"), numbers, strict=False):
        if not (number.is_integer() and abs(number) < 2**53):
            raise DataError(path, f"line {line}, {name}", number, "a whole number")
    return numbers

"""What results were made with, beside their configuration: the code and the weights."""

from __future__ import annotations

import hashlib
import inspect
from functools import cache
from pathlib import Path

import mottrack
from mottrack.core.errors import DataError
from mottrack.experiment.experiment import Experiment

PACKAGE = Path(mottrack.__file__).parent
ROOMS = (
    "core",
    "lidar",
    "geometry",
    "formats",
    "datasets",
    "flow",
    "objects",
    "trackers",
    "pipeline",
)
"""Their code decides what a scene's result is; evaluation, reports and pictures start from it."""


def fingerprint(experiment: Experiment) -> dict[str, str]:
    """What to compare, in words that name it, with a digest of each.

    Raises:
        DataError: a file of weights is missing.
    """
    weights = {f"weights {file.name}": _digest([file]) for file in _files(experiment)}
    return {
        "configuration": experiment.hash,
        "version": mottrack.__version__,
        "code": hashlib.sha256((_package() + _digest(_plug_ins(experiment))).encode()).hexdigest(),
        **weights,
    }


def _files(experiment: Experiment) -> list[Path]:
    return [file for part in experiment.parts for file in part.files()]


def _plug_ins(experiment: Experiment) -> list[Path]:
    """Sources of the user's own classes."""
    classes = [part.cls for part in experiment.parts if ":" in part.kind]
    return sorted({Path(file) for cls in classes if (file := inspect.getsourcefile(cls))})


@cache
def _package() -> str:
    """Of the package's own sources; once a process, which does not import them again."""
    return _digest(sorted(file for room in ROOMS for file in (PACKAGE / room).rglob("*.py")))


def _digest(files: list[Path]) -> str:
    """SHA-256 of names and contents, in the order given."""
    digest = hashlib.sha256()
    for file in files:
        name = file.relative_to(PACKAGE) if file.is_relative_to(PACKAGE) else file.name
        digest.update(f"{name}\0".encode())
        digest.update(_content(file))
    return digest.hexdigest()


def _content(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise DataError(file, "file", error.strerror, "a readable file") from error

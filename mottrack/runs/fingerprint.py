"""What results are made with: configuration, version, code and weights."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from mottrack._version import __version__
from mottrack.core.errors import DataError
from mottrack.experiment.experiment import Experiment
from mottrack.experiment.plugins import Part

PACKAGE = Path(__file__).resolve().parents[1]
SOURCES = (
    "core",
    "lidar",
    "geometry",
    "formats",
    "world",
    "datasets",
    "flow",
    "objects",
    "trackers",
    "experiment",
    "pipeline",
)
"""Packages whose code decides the result of a scene; evaluation, reports and pictures read it."""


def fingerprint(experiment: Experiment) -> dict[str, str]:
    """Return what results are made with, by name: configuration, version, code and weights.

    Raises:
        DataError: a file of weights is missing.
    """
    return {"configuration": experiment.hash, **code_and_weights(experiment.parts)}


def code_and_weights(parts: Sequence[Part], more: Sequence[Path] = ()) -> dict[str, str]:
    """Return the version and the digests of the code and of the files of weights of some parts.

    Args:
        parts: of an experiment.
        more: files of code beside the package's own `SOURCES`.

    Raises:
        DataError: a file of weights is missing.
    """
    files = [file for part in parts for file in part.files()]
    plug_ins = [part.cls for part in parts if ":" in part.kind]
    found = {Path(file) for cls in plug_ins if (file := inspect.getsourcefile(cls))}
    sources = sorted(found | set(more))
    return {
        "version": __version__,
        "code": hashlib.sha256((_package_digest() + _digest(sources)).encode()).hexdigest(),
        **{f"weights {file.name}": _digest([file]) for file in files},
    }


@cache
def _package_digest() -> str:
    """Return the digest of the package's sources, once per process: it runs what it imported."""
    modules = [PACKAGE / "compiled.py", PACKAGE / "config.py"]
    inside = [file for name in SOURCES for file in (PACKAGE / name).rglob("*.py")]
    return _digest(sorted([*modules, *inside]))


def _digest(files: list[Path]) -> str:
    """Return the SHA-256 of names and contents, in the order given."""
    digest = hashlib.sha256()
    for file in files:
        name = file.relative_to(PACKAGE) if file.is_relative_to(PACKAGE) else file.name
        digest.update(f"{name}\0".encode())
        try:
            digest.update(file.read_bytes())
        except OSError as error:
            raise DataError(file, "file", error.strerror, "a readable file") from error
    return digest.hexdigest()

"""A cache of ground truth: reading the tables of a full data set takes half a minute.

A cached file names the tables it was made from with their sizes and times of change, and is made
again when any of them differs. It lies in `$MOTTRACK_CACHE`, else in the user's cache folder; the
data set itself is never written to.
"""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.errors import ResultError
from mottrack.core.storage import read_arrays, write_arrays
from mottrack.eval.nuscenes.boxes import BoxTable, GroundTruth, Racks, Samples
from mottrack.eval.nuscenes.groundtruth import TABLES, read_ground_truth
from mottrack.eval.nuscenes.rules import Rules
from mottrack.formats.cache import cache_folder
from mottrack.formats.nuscenes_tables import table_path

FORMAT = "mottrack ground truth 1"
_PARTS = {"samples": Samples, "boxes": BoxTable, "racks": Racks}


def cached_ground_truth(
    dataroot: Path, version: str, scene_names: Sequence[str], rules: Rules | None = None
) -> GroundTruth:
    """As `read_ground_truth`, from the cache where that is up to date.

    A cache that cannot be read or written is done without.
    """
    rules = rules or Rules()
    source = fingerprint(dataroot, version)
    what = json.dumps([sorted(scene_names), list(rules.classes)])
    path = cache_folder() / f"{_digest(str(dataroot.resolve()), version, what)}.npz"
    stored = _read(path, source)
    if stored is not None:
        return stored
    truth = read_ground_truth(dataroot, version, scene_names, rules)
    _write(path, source, truth)
    return truth


def fingerprint(dataroot: Path, version: str) -> str:
    """Names, sizes and times of change of the tables, as text."""
    paths = [table_path(dataroot, version, name) for name in TABLES]
    return json.dumps([(p.name, p.stat().st_size, p.stat().st_mtime_ns) for p in paths])


def _digest(*texts: str) -> str:
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()[:24]


def _read(path: Path, source: str) -> GroundTruth | None:
    if not path.is_file():
        return None
    try:
        arrays = read_arrays(path)
    except ResultError:
        return None
    if str(arrays.get("format")) != FORMAT or str(arrays.get("source")) != source:
        return None
    parts: dict[str, Any] = {
        prefix: kind(**{f.name: arrays[f"{prefix}.{f.name}"] for f in fields(kind)})
        for prefix, kind in _PARTS.items()
    }
    return GroundTruth(**parts)


def _write(path: Path, source: str, truth: GroundTruth) -> None:
    arrays: dict[str, NDArray[Any]] = {"format": np.array(FORMAT), "source": np.array(source)}
    for prefix in _PARTS:
        part = asdict(getattr(truth, prefix))
        arrays |= {f"{prefix}.{name}": value for name, value in part.items()}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_arrays(path, arrays)
    except OSError:
        return

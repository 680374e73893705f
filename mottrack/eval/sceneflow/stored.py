"""The scene flow sums of a scene as a file beside its result."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mottrack.core.errors import ResultError
from mottrack.core.storage import read_arrays, write_arrays
from mottrack.eval.sceneflow.categories import GROUPS
from mottrack.eval.sceneflow.sums import BUCKET_EDGES_M, SUMS, THREEWAY_EDGES_M, SceneFlowSums

FORMAT = "mottrack scene flow sums 1"
SHAPES = {
    "official": (2, 2, 2, len(SUMS)),
    "motion": (3,),
    "buckets": (len(GROUPS), len(BUCKET_EDGES_M) - 1, 3),
    "threeway": (len(GROUPS), len(THREEWAY_EDGES_M) - 1, 3),
}
"""Of the sums of a run: it knows positions and ego motion, so it has all of them."""


def empty_sums() -> SceneFlowSums:
    """Return the sums of a scene without any point that counts."""
    return SceneFlowSums(**{name: np.zeros(shape) for name, shape in SHAPES.items()}, rows={})


def save_sums(path: Path, sums: SceneFlowSums) -> None:
    """Store the sums of a run's scene, atomically."""
    arrays: dict[str, NDArray[Any]] = {
        "row_names": np.array(list(sums.rows), np.str_),
        "rows": np.array(list(sums.rows.values())).reshape(-1, len(SUMS)),
    }
    arrays |= {name: np.asarray(getattr(sums, name)) for name in SHAPES}
    write_arrays(path, arrays, FORMAT)


def load_sums(path: Path) -> SceneFlowSums:
    """Read what `save_sums` wrote.

    Raises:
        ResultError: the file is missing, damaged, or of another version.
    """
    arrays = read_arrays(path, FORMAT)
    tables = {name: arrays[name] for name in SHAPES}
    names, rows = arrays["row_names"].tolist(), arrays["rows"]
    for name, shape in SHAPES.items():
        if tables[name].shape != shape:
            raise ResultError(path, f"shape of {name}", tables[name].shape, str(shape))
    if rows.shape != (len(names), len(SUMS)):
        raise ResultError(path, "shape of rows", rows.shape, str((len(names), len(SUMS))))
    return SceneFlowSums(**tables, rows=dict(zip(names, rows, strict=True)))

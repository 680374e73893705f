"""Files of the Argoverse 2 scene flow challenge: annotations, predictions and masks.

One feather file a pair of sweeps, `LOG/TIMESTAMP_NS.feather` after the first one. Annotations have
`category_indices`, `is_close`, `is_dynamic`, `is_valid` and the flow, predictions the flow and
`is_dynamic`, as many rows. Flow is `flow_tx_m`, `flow_ty_m`, `flow_tz_m`, the vehicle's own motion
included, as float16: it is rounded to a 2048th part.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.feather
from numpy.typing import NDArray

from mottrack.core.arrays import Mask
from mottrack.core.errors import DataError
from mottrack.core.storage import write_bytes
from mottrack.eval.sceneflow.categories import CATEGORIES
from mottrack.eval.sceneflow.points import FlowPoints
from mottrack.formats.columns import ColumnSpec, specs
from mottrack.formats.feather import read_feather_columns
from mottrack.formats.files import existing_folder, read_bytes

FLOW = ("flow_tx_m", "flow_ty_m", "flow_tz_m")
_PREDICTION = (*specs(*FLOW), ColumnSpec("is_dynamic", bool))
_ANNOTATION = (
    *_PREDICTION,
    ColumnSpec("is_close", bool),
    ColumnSpec("is_valid", bool),
    ColumnSpec("category_indices", int),
)
_MASK = (ColumnSpec("mask", bool),)


@dataclass(frozen=True)
class FileSet:
    """A folder or a zip archive of such files."""

    path: Path

    def bytes_of(self, name: str) -> bytes:
        """Return the content of `LOG/TIMESTAMP_NS.feather`.

        Raises:
            DataError: it is missing or unreadable.
        """
        if self.path.is_dir():
            return read_bytes(self.path / name)
        try:
            with zipfile.ZipFile(self.path) as archive:
                return archive.read(name)
        except KeyError as error:
            raise DataError(self.path, name, "missing", "a file for each pair") from error
        except (OSError, zipfile.BadZipFile, RuntimeError) as error:
            raise DataError(self.path, "archive", str(error), "a folder or a zip file") from error

    @cached_property
    def names(self) -> frozenset[str]:
        """Every `LOG/TIMESTAMP_NS.feather` in it.

        Raises:
            DataError: it is neither a folder nor a readable archive.
        """
        if self.path.is_dir():
            return frozenset(f"{p.parent.name}/{p.name}" for p in self.path.glob("*/*.feather"))
        try:
            with zipfile.ZipFile(self.path) as archive:
                return frozenset(archive.namelist())
        except (OSError, zipfile.BadZipFile) as error:
            raise DataError(self.path, "archive", str(error), "a folder or a zip file") from error

    def mask(self, log: str, stamp_ns: int) -> Mask | None:
        """Return which points of a sweep a submission must predict, (N,); None for none."""
        name = f"{log}/{stamp_ns}.feather"
        if name not in self.names:
            return None
        mask = read_feather_columns(self.path / name, _MASK, data=self.bytes_of(name))["mask"]
        return np.asarray(mask, np.bool_)


def annotated_pairs(truth: Path) -> dict[str, list[str]]:
    """Return the names of the annotation files by log, both in order.

    Raises:
        DataError: there is none.
    """
    files = sorted(existing_folder(truth, "annotations").glob("*/*.feather"))
    if not files:
        raise DataError(truth, "annotations", "none", "files LOG/TIMESTAMP_NS.feather")
    logs: dict[str, list[str]] = {}
    for path in files:
        logs.setdefault(path.parent.name, []).append(f"{path.parent.name}/{path.name}")
    return logs


def read_points(truth: Path, predictions: FileSet, name: str) -> FlowPoints:
    """Return the points of one pair.

    Raises:
        DataError: a file is missing or damaged, or they differ in length.
    """
    true = read_feather_columns(truth / name, _ANNOTATION)
    true.refuse(
        "category_indices",
        (true["category_indices"] < 0) | (true["category_indices"] >= len(CATEGORIES)),
        f"0 to {len(CATEGORIES) - 1}",
    )
    said = read_feather_columns(
        predictions.path / name, _PREDICTION, data=predictions.bytes_of(name)
    )
    if len(said) != len(true):
        raise DataError(predictions.path, name, f"{len(said)} rows", f"{len(true)}, as annotated")
    return FlowPoints(
        truth_m=true.stacked(FLOW),
        estimate_m=said.stacked(FLOW),
        category=true["category_indices"],
        dynamic=true["is_dynamic"],
        dynamic_estimate=said["is_dynamic"],
        close=true["is_close"],
        valid=true["is_valid"],
    )


def all_points(truth: Path, predictions: Path, log: str) -> Iterator[FlowPoints]:
    """Yield the points of every pair of a log in order."""
    for name in annotated_pairs(truth)[log]:
        yield read_points(truth, FileSet(predictions), name)


def write_prediction(folder: Path, name: str, points: FlowPoints) -> None:
    """Write the estimate of one pair as the challenge wants it."""
    flow = {axis: points.estimate_m[:, i].astype(np.float16) for i, axis in enumerate(FLOW)}
    _write(folder / name, flow | {"is_dynamic": points.dynamic_estimate})


def pack_predictions(folder: Path, names: Sequence[str], archive: Path) -> None:
    """Pack written estimates into one archive, as it is handed in; equal files give equal bytes.

    Args:
        folder: where `write_prediction` has written them.
        names: `LOG/TIMESTAMP_NS.feather` of each.
        archive: zip file.
    """
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as packed:
        for name in sorted(names):
            # a fixed date, and the rights of a plain file
            info = zipfile.ZipInfo(name)
            info.compress_type, info.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            packed.writestr(info, (folder / name).read_bytes())
    write_bytes(archive, buffer.getvalue())


def write_annotation(folder: Path, name: str, points: FlowPoints) -> None:
    """Write the truth of one pair as the official evaluation reads it."""
    flow = {axis: points.truth_m[:, i].astype(np.float16) for i, axis in enumerate(FLOW)}
    columns = {
        "category_indices": np.maximum(points.category, 0).astype(np.uint8),
        "is_close": points.close,
        "is_dynamic": points.dynamic,
        "is_valid": points.valid,
    }
    _write(folder / name, columns | flow)


def _write(path: Path, columns: dict[str, NDArray[Any]]) -> None:
    sink = pa.BufferOutputStream()
    pyarrow.feather.write_feather(pa.table(columns), sink)
    write_bytes(path, sink.getvalue().to_pybytes())

"""A flow field as bytes, the same bit for bit when it is read again."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mottrack.core.grid import BevGrid
from mottrack.core.motion import FlowField


class StoredFlow(NamedTuple):
    """A field with what it was made from and what it took."""

    digest: bytes
    flow: FlowField
    seconds: float
    parts: dict[str, float]


def packed(stored: StoredFlow) -> bytes:
    """Return a field as the bytes of an npz: only the cells of which any bit is set."""
    flow, grid = stored.flow, stored.flow.grid
    rows = {
        "velocity_mps": flow.velocity_mps.reshape(-1, 2),
        "covariance_m2ps2": flow.covariance_m2ps2.reshape(-1, 4),
        "occupied": flow.occupied.reshape(-1, 1),
        "valid": flow.valid.reshape(-1, 1),
        "weight": flow.weight.reshape(-1, 1),
    }
    rows = {name: np.ascontiguousarray(values) for name, values in rows.items()}
    cells = np.flatnonzero(
        np.any([values.view(np.uint8).any(axis=1) for values in rows.values()], axis=0)
    )
    buffer = io.BytesIO()
    np.savez(
        buffer,
        digest=np.frombuffer(stored.digest, np.uint8),
        stamp_ns=np.int64(flow.stamp_ns),
        grid=np.array((grid.x_min_m, grid.x_max_m, grid.y_min_m, grid.y_max_m, grid.cell_m)),
        seconds=np.float64(stored.seconds),
        part_names=np.array(list(stored.parts), dtype=np.str_),
        part_seconds=np.array(list(stored.parts.values()), np.float64),
        cells=cells.astype(np.int32),
        **{name: values[cells] for name, values in rows.items()},  # type: ignore[arg-type]
    )
    return buffer.getvalue()


def unpacked(data: bytes) -> StoredFlow:
    """Read what `packed` has made.

    Raises:
        ValueError, KeyError: it is something else.
    """
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        arrays: Mapping[str, NDArray[Any]] = {name: file[name] for name in file.files}
    grid = BevGrid(*(float(x) for x in arrays["grid"]))
    count = int(np.prod(grid.shape))

    def whole(name: str, *shape: int) -> NDArray[Any]:
        values = arrays[name]
        full = np.zeros((count, values.shape[1]), values.dtype)
        full[arrays["cells"]] = values
        return full.reshape(*grid.shape, *shape)

    flow = FlowField(
        grid=grid,
        velocity_mps=whole("velocity_mps", 2),
        covariance_m2ps2=whole("covariance_m2ps2", 2, 2),
        occupied=whole("occupied"),
        valid=whole("valid"),
        weight=whole("weight"),
        stamp_ns=int(arrays["stamp_ns"]),
    )
    names, seconds = arrays["part_names"].tolist(), arrays["part_seconds"].tolist()
    parts = dict(zip(names, seconds, strict=True))
    return StoredFlow(arrays["digest"].tobytes(), flow, float(arrays["seconds"]), parts)

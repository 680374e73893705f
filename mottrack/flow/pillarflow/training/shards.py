"""Examples on disk: safetensors shards, read by memory map so that they stream.

Positions are stored as int16 of 2 mm (within 65 m), reflectance as a byte, so a pair of 64-ring
sweeps takes about half a megabyte.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from mottrack.core.arrays import F32, I16
from mottrack.core.errors import DataError
from mottrack.core.storage import write_bytes
from mottrack.flow.pillarflow.training.examples import Example

STEP_M = 0.002
"""Resolution of a stored position: a tenth of a LiDAR's noise, and int16 reaches 65 m."""
_POINTS = ("previous", "current", "older")
"""Fields that are stored in steps of `STEP_M`."""
_FIXED = ("seen", "elapsed_s", "older_age_s")
"""Fields of one length."""
_RAGGED = (
    *_POINTS,
    "previous_object",
    "current_object",
    "previous_sight",
    "current_sight",
    "older_object",
    "older_slot",
    "motion_m",
    "centre_m",
)
"""Fields whose length differs from one example to the next; each has its offsets beside it."""


def _packed(points: F32) -> I16:
    scaled = np.column_stack((points[:, :3] / STEP_M, points[:, 3] * 255))
    return np.clip(np.round(scaled), -32768, 32767).astype(np.int16)


def _unpacked(points: I16) -> F32:
    scale = np.array([STEP_M, STEP_M, STEP_M, 1 / 255], np.float32)
    return points.astype(np.float32) * scale


def write_shard(file: Path, examples: list[Example]) -> None:
    """Write examples to one shard, atomically."""
    columns: dict[str, NDArray[Any]] = {}
    for name in _RAGGED:
        parts = [getattr(example, name) for example in examples]
        lengths = [len(part) for part in parts]
        columns[f"{name}.start"] = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
        joined = np.concatenate(parts)
        columns[name] = _packed(joined) if name in _POINTS else joined
    columns["seen"] = np.stack([example.seen for example in examples])
    columns["older_age_s"] = np.stack([example.older_age_s for example in examples])
    columns["elapsed_s"] = np.array([example.elapsed_s for example in examples])
    write_bytes(file, save({k: np.ascontiguousarray(v) for k, v in columns.items()}))


class Shards(Sequence[Example]):
    """Examples of all shards of a directory."""

    def __init__(self, directory: Path) -> None:
        """Open the shards in order of name.

        Raises:
            DataError: there is none, or one is torn.
        """
        files = sorted(directory.glob("*.safetensors"))
        if not files:
            raise DataError(directory, "shards", "absent", "*.safetensors files of examples")
        self._shards = [_opened(file) for file in files]
        counts = [len(shard["elapsed_s"]) for shard in self._shards]
        self._starts = np.concatenate([[0], np.cumsum(counts)])

    def __len__(self) -> int:
        return int(self._starts[-1])

    @overload
    def __getitem__(self, index: int) -> Example: ...

    @overload
    def __getitem__(self, index: slice) -> list[Example]: ...

    def __getitem__(self, index: int | slice) -> Example | list[Example]:
        if isinstance(index, slice):
            return [self._read(row) for row in range(*index.indices(len(self)))]
        if not 0 <= index < len(self):
            raise IndexError(index)
        return self._read(index)

    def _read(self, index: int) -> Example:
        which = int(np.searchsorted(self._starts, index, side="right")) - 1
        shard, row = self._shards[which], index - int(self._starts[which])
        parts = {name: _part(shard, name, row) for name in _RAGGED}
        return Example(
            previous=_unpacked(parts.pop("previous")),
            current=_unpacked(parts.pop("current")),
            older=_unpacked(parts.pop("older")),
            seen=shard["seen"][row],
            elapsed_s=float(shard["elapsed_s"][row]),
            older_age_s=shard["older_age_s"][row],
            **parts,
        )


def _part(shard: dict[str, Any], name: str, row: int) -> NDArray[Any]:
    start = shard[f"{name}.start"]
    part: NDArray[Any] = shard[name][int(start[row]) : int(start[row + 1])]
    return part


def _opened(file: Path) -> dict[str, Any]:
    """Open a shard: small columns in memory, the large ones as slices of the mapped file."""
    try:
        handle: Any = safe_open(file, framework="np")
        names = set(handle.keys())
        expected = {*_RAGGED, *(f"{name}.start" for name in _RAGGED), *_FIXED}
        if names != expected:
            raise DataError(file, "columns", sorted(names), f"{sorted(expected)}")
        small = {n for n in names if n.endswith(".start")} | {"elapsed_s", "older_age_s"}
        # a column without rows, of pairs without older sweeps, has no slices
        small |= {n for n in names if not handle.get_slice(n).get_shape()[0]}
        return {n: handle.get_tensor(n) if n in small else handle.get_slice(n) for n in names}
    except SafetensorError as error:
        raise DataError(file, "content", str(error), "a safetensors file of examples") from error

"""Bicycle racks: what lies in one is not evaluated if it is a bicycle or a motorcycle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.tables import BoxTable, TruthTable
from mottrack.eval.nuscenes.boxes import Racks
from mottrack.formats.nuscenes_classes import RACK_CATEGORY, RACKED_CLASSES


def racks_in(truth: Sequence[TruthTable], offsets: Sequence[int]) -> Racks:
    """Return the racks among the truth of scenes; `offsets` count the samples before each."""
    parts = [table.select(table.label == RACK_CATEGORY) for table in truth]
    rows = TruthTable.stacked(parts)
    before = np.repeat(np.array(offsets[: len(parts)], np.int64), [len(part) for part in parts])
    zero = np.zeros(len(rows))
    half = rows.yaw_rad / 2
    return Racks(
        sample=rows.frame + before,
        centre_m=rows.centre_m,
        size_m=rows.size_m[:, [1, 0, 2]],
        rotation_wxyz=np.column_stack([np.cos(half), zero, zero, np.sin(half)]),
    )


def outside_racks(boxes: BoxTable, truth: TruthTable) -> Mask:
    """Return (N,) the boxes of a scene that are evaluated, given its truth."""
    outside = np.ones(len(boxes), np.bool_)
    suspects = np.flatnonzero(np.isin(boxes.label, RACKED_CLASSES))
    racks = racks_in([truth], [0])
    outside[suspects[in_rack(boxes.frame[suspects], boxes.centre_m[suspects], racks)]] = False
    return outside


def in_rack(sample: I64, centre_m: F64, racks: Racks) -> Mask:
    """Return (N,) whether a centre (N, 3) lies in a rack of its sample (N,), faces included."""
    order = np.argsort(racks.sample, kind="stable")
    first = np.searchsorted(racks.sample[order], sample, "left")
    count = np.searchsorted(racks.sample[order], sample, "right") - first
    box = np.repeat(np.arange(len(sample)), count)
    within = np.arange(len(box)) - np.repeat(np.cumsum(count) - count, count)
    rack = order[first[box] + within]
    corners = _corners(racks)[rack]
    inside = np.ones(len(box), np.bool_)
    offset = centre_m[box] - corners[:, 0]
    for end in (1, 2, 3):
        edge = corners[:, end] - corners[:, 0]
        along = (edge * offset).sum(axis=1)
        inside &= (along >= 0) & (along <= (edge * edge).sum(axis=1))
    return np.bincount(box[inside], minlength=len(sample)) > 0


def _corners(racks: Racks) -> F64:
    """Return a corner of each rack and its neighbours along the three edges, (R, 4, 3)."""
    width, length, height = racks.size_m.T / 2
    signs = np.array([[1, 1, 1], [-1, 1, 1], [1, -1, 1], [1, 1, -1]])
    local = signs[None] * np.stack([length, width, height], axis=1)[:, None]
    rotated: F64 = np.einsum("rij,rkj->rki", _rotations(racks.rotation_wxyz), local)
    return rotated + racks.centre_m[:, None]


def _rotations(quaternion_wxyz: F64) -> F64:
    """Return rotation matrices, (R, 3, 3)."""
    norm = np.linalg.norm(quaternion_wxyz, axis=1, keepdims=True)
    w, x, y, z = (quaternion_wxyz / np.where(norm > 0, norm, 1.0)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)

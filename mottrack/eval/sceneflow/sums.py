"""What a scene's points contribute to every figure of scene flow: sums that add up.

All figures are functions of these sums, so scenes are evaluated one by one, put together and drawn
again for intervals without keeping a point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mottrack.core.arrays import F64, Mask
from mottrack.eval.arithmetic import SPEED_EDGES_MPS, bins
from mottrack.eval.flow_error import RANGE_EDGES_M
from mottrack.eval.sceneflow.categories import BACKGROUND, CATEGORIES, GROUPS, group_table
from mottrack.eval.sceneflow.points import (
    CLOSE_M,
    DYNAMIC_M,
    PAIR_S,
    FlowPoints,
    PointErrors,
    point_errors,
)

BUCKET_EDGES_M = np.append(np.linspace(0.0, 2.0, 51), np.inf)
"""51 buckets of true speed, 0.4 m/s wide at 10 Hz, the last one open (Khatri et al., 2024)."""
THREEWAY_EDGES_M = np.array([0.0, DYNAMIC_M, np.inf])
SUMS = ("points", "strict", "relaxed", "angle_rad", "epe_m")
"""Order of the sums of a row."""


@dataclass(frozen=True)
class SceneFlowSums:
    """Sums over the points of a scene; a part that the data do not allow is None."""

    official: F64
    """(2, 2, 2, 5) foreground, dynamic and close (no, yes), then `SUMS`."""
    motion: F64
    """(3,) points that are dynamic and said so, said so only, dynamic only."""
    rows: dict[str, F64] = field(default_factory=dict)
    """By range, speed and class: `SUMS`, (5,) each."""
    buckets: F64 | None = None
    """(5, 51, 3) `GROUPS` by `BUCKET_EDGES_M`: points, EPE, true displacement."""
    threeway: F64 | None = None
    """(5, 2, 3) the same, split at `DYNAMIC_M`."""


def frame_sums(points: FlowPoints) -> SceneFlowSums:
    """Return the sums of the points of one sweep."""
    points = points.counted()
    errors = point_errors(points.truth_m, points.estimate_m)
    subset = (points.category != BACKGROUND) * 4 + points.dynamic * 2 + points.close
    official = _binned(subset, errors, 8).reshape(2, 2, 2, len(SUMS))
    truth, said = points.dynamic, points.dynamic_estimate
    counts = [np.count_nonzero(m) for m in (truth & said, ~truth & said, truth & ~said)]
    rows = {name: _row(mask, errors) for name, mask in _masks(points).items()}
    motion = np.array(counts, np.float64)
    if points.ego_motion_m is None or points.xy_m is None:
        return SceneFlowSums(official, motion, rows)
    tables = [_buckets(points, errors.epe_m, e) for e in (BUCKET_EDGES_M, THREEWAY_EDGES_M)]
    return SceneFlowSums(official, motion, rows, *tables)


def _binned(subset: F64, errors: PointErrors, size: int) -> F64:
    """Return `SUMS` of each subset, (size, 5)."""
    columns = [np.bincount(subset, minlength=size)]
    columns += [np.bincount(subset, column, size) for column in errors]
    return np.stack(columns, axis=1).astype(np.float64)


def _row(mask: Mask, errors: PointErrors) -> F64:
    return np.array([np.count_nonzero(mask), *(column[mask].sum() for column in errors)])


def _masks(points: FlowPoints) -> dict[str, Mask]:
    """Return the rows that need no more than the points themselves tell, in their order."""
    masks: dict[str, Mask] = {}
    if points.xy_m is not None:
        masks |= bins(np.linalg.norm(points.xy_m, axis=1), RANGE_EDGES_M, "m", "range")
    if points.ego_motion_m is not None:
        masks |= bins(points.speed_m / PAIR_S, SPEED_EDGES_MPS, "m/s", "speed")
    for number in np.unique(points.category[points.dynamic]).tolist():
        name = CATEGORIES[number].lower()
        masks[f"moving {name}"] = points.dynamic & (points.category == number)
    return masks


def _buckets(points: FlowPoints, epe_m: F64, edges: F64) -> F64:
    """Return points, EPE and true displacement by group and bucket of speed, (5, B, 3)."""
    size = len(edges) - 1
    group = group_table()[points.category]
    near = np.abs(np.asarray(points.xy_m)).max(axis=1, initial=0.0) < CLOSE_M
    speed_m = points.speed_m
    cell = group * size + np.searchsorted(edges, speed_m, side="right") - 1
    keep = near & (group >= 0)
    weights = (np.ones(np.count_nonzero(keep)), epe_m[keep], speed_m[keep])
    sums = [np.bincount(cell[keep], w, len(GROUPS) * size) for w in weights]
    return np.stack(sums, axis=1, dtype=np.float64).reshape(len(GROUPS), size, 3)


def total(parts: Sequence[SceneFlowSums]) -> SceneFlowSums:
    """Return the sums of several sweeps, of at least one, together."""
    names = list(dict.fromkeys(name for part in parts for name in part.rows))
    rows = {n: np.sum([p.rows[n] for p in parts if n in p.rows], axis=0) for n in names}
    official = np.sum([p.official for p in parts], axis=0)
    motion = np.sum([p.motion for p in parts], axis=0)
    tables = [[getattr(p, name) for p in parts] for name in ("buckets", "threeway")]
    whole = [None if any(t is None for t in ts) else np.sum(ts, axis=0) for ts in tables]
    return SceneFlowSums(official, motion, rows, *whole)

"""Ground removal: a RANSAC plane and a local ground height relative to it.

The plane is fitted to the low points of 1 m cells, so that it costs the same for any sweep. From
the sensor outwards each cell's low point is accepted as ground if it continues the ground already
found, which follows slopes, crowns and kerbs where one plane cannot. (The paper removes "points
lying on a ground plane obtained with the RANSAC algorithm", section IV-B.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from mottrack.compiled import compiled
from mottrack.config import StrictModel
from mottrack.core.arrays import F32, F64, I64, Mask
from mottrack.core.checks import as_array
from mottrack.core.timing import timed

_LOWEST = 4
"""Low points kept per cell, for the 5 % quantile of up to 60 points."""
_LOW_SHARE = 0.05
"""Quantile of the heights that stands for a cell: single returns from below the road (reflections)
are passed over."""
_WINDOW_CELLS = 2
"""Half width of the window in which ground continues and its height is smoothed."""
_SCORED = 500
"""Low points on which the planes are scored; the best plane is then fitted to all of them."""
_REFITS = 3
"""Least-squares fits to the inliers of the last fit; their set changes little after that."""


class GroundConfig(StrictModel):
    """How ground is found; distances in metres."""

    cell_m: float = Field(1.0, gt=0, description="cell whose low point is taken as the ground")
    reach_m: float = Field(
        70.0, gt=0, description="half width of the square in which ground is estimated"
    )
    fit_range_m: float = Field(
        30.0, gt=0, description="cells farther than this do not count in the plane fit"
    )
    inlier_m: float = Field(0.15, gt=0, description="largest distance of an inlier from the plane")
    max_slope: float = Field(0.15, gt=0, description="steepest plane relative to the ego frame")
    continues_m: float = Field(
        0.25, gt=0, description="largest step between neighbouring ground cells"
    )
    thickness_m: float = Field(0.3, gt=0, description="points lower than this are ground")
    hypotheses: int = Field(200, ge=1, description="planes tried")
    seed: int = Field(0, ge=0, description="seed of the three-point samples")


@dataclass(frozen=True)
class Ground:
    """The ground under one sweep."""

    height_m: F32
    """(N,) height of each point above the local ground."""
    is_ground: Mask
    """(N,) points lower than the thickness of the ground."""
    plane: F64
    """(3,) z = plane[0] * x + plane[1] * y + plane[2], ego frame."""


@timed("ground")
def find_ground(xyz_m: F32, config: GroundConfig | None = None) -> Ground:
    """Estimate the ground of a sweep (N, 3) in the ego frame.

    The plane has the most inliers among the low cells, less a penalty for cells below it. It may
    lie at any height and have any slope up to `max_slope`. With fewer than three low cells it is
    level, at the lowest of them.

    Raises:
        InputError: `xyz_m` has another shape.
    """
    config = config or GroundConfig()
    points = np.array(as_array("xyz_m", xyz_m, np.float32, (None, 3)))
    cells = int(np.ceil(2 * config.reach_m / config.cell_m))
    low_m, counts = _low_points(points, config.reach_m, config.cell_m, cells)
    centre_m = (np.arange(cells) + 0.5) * config.cell_m - config.reach_m
    rows, cols = np.nonzero(counts)
    low_points_m = np.column_stack([centre_m[cols], centre_m[rows], low_m[rows, cols]])
    range_m = np.hypot(low_points_m[:, 0], low_points_m[:, 1])
    plane = fit_plane(low_points_m[range_m < config.fit_range_m], config)
    residual_m = low_m - (plane[0] * centre_m[None] + plane[1] * centre_m[:, None] + plane[2])
    outwards = np.column_stack([rows, cols])[np.argsort(range_m, kind="stable")]
    terrain_m = _terrain(residual_m, outwards, config.continues_m)
    height_m = _heights(points, plane, terrain_m, config.reach_m, config.cell_m)
    return Ground(height_m, height_m < config.thickness_m, plane)


def fit_plane(low_points_m: F64, config: GroundConfig) -> F64:
    """Fit the plane (3,) z = a x + b y + c to the low points (M, 3) by seeded RANSAC."""
    if len(low_points_m) < 3:
        level_m = low_points_m[:, 2].min() if len(low_points_m) else 0.0
        return np.array([0.0, 0.0, level_m])
    rng = np.random.default_rng(config.seed)
    samples = rng.integers(len(low_points_m), size=(config.hypotheses, 3))
    scored = low_points_m[:: max(len(low_points_m) // _SCORED, 1)]
    plane = _ransac(scored, low_points_m[samples], config.inlier_m, config.max_slope)
    for _ in range(_REFITS):
        residual_m = low_points_m[:, 2] - low_points_m[:, :2] @ plane[:2] - plane[2]
        inlier = np.abs(residual_m) < config.inlier_m
        if inlier.sum() < 3:
            break
        design = np.column_stack([low_points_m[inlier, :2], np.ones(inlier.sum())])
        plane = np.linalg.lstsq(design, low_points_m[inlier, 2], rcond=None)[0]
    return plane


@compiled
def _low_points(xyz_m: F32, reach_m: float, cell_m: float, cells: int) -> tuple[F64, I64]:
    """Return the 5 % quantile of z in each cell, from its few lowest points, and the counts."""
    lowest = np.full((cells * cells, _LOWEST), np.inf, np.float32)
    counts = np.zeros(cells * cells, np.int64)
    reach, per_cell = np.float32(reach_m), np.float32(1.0 / cell_m)
    for i in range(len(xyz_m)):
        x, y = (xyz_m[i, 0] + reach) * per_cell, (xyz_m[i, 1] + reach) * per_cell
        if not (0 <= x < cells and 0 <= y < cells):
            continue
        cell = int(y) * cells + int(x)
        counts[cell] += 1
        z_m = xyz_m[i, 2]
        if z_m < lowest[cell, _LOWEST - 1]:
            rank = _LOWEST - 1
            while rank > 0 and lowest[cell, rank - 1] > z_m:
                lowest[cell, rank] = lowest[cell, rank - 1]
                rank -= 1
            lowest[cell, rank] = z_m
    low_m = np.zeros(cells * cells)
    for cell in range(cells * cells):
        if counts[cell] > 0:
            low_m[cell] = lowest[cell, min(int(_LOW_SHARE * counts[cell]), _LOWEST - 1)]
    return low_m.reshape(cells, cells), counts.reshape(cells, cells)


@compiled
def _ransac(low_points_m: F64, samples: F64, inlier_m: float, max_slope: float) -> F64:
    """Return the plane through three sampled points with the best score.

    An inlier scores by its squared residual (MSAC, Torr and Zisserman, 2000). A point more than
    two inlier distances below costs half of one: the ground is the lowest surface.
    """
    best = np.array([0.0, 0.0, np.median(low_points_m[:, 2])])
    best_score = -np.inf
    for s in range(len(samples)):
        p, q, r = samples[s, 0], samples[s, 1], samples[s, 2]
        det = (q[0] - p[0]) * (r[1] - p[1]) - (r[0] - p[0]) * (q[1] - p[1])
        if abs(det) < 1.0:  # square metres: nearly collinear samples
            continue
        a = ((q[2] - p[2]) * (r[1] - p[1]) - (r[2] - p[2]) * (q[1] - p[1])) / det
        b = ((q[0] - p[0]) * (r[2] - p[2]) - (r[0] - p[0]) * (q[2] - p[2])) / det
        if a * a + b * b > max_slope * max_slope:
            continue
        c = p[2] - a * p[0] - b * p[1]
        score = 0.0
        for i in range(len(low_points_m)):
            residual = low_points_m[i, 2] - a * low_points_m[i, 0] - b * low_points_m[i, 1] - c
            if abs(residual) < inlier_m:
                score += 1.0 - (residual / inlier_m) ** 2
            elif residual < -2 * inlier_m:
                score -= 0.5
        if score > best_score:
            best_score = score
            best[0], best[1], best[2] = a, b, c
    return best


@compiled
def _terrain(residual_m: F64, outwards: I64, continues_m: float) -> F64:
    """Return the local ground height over the plane: grown outwards, then median-filtered.

    `outwards` (M, 2) are the row and column of the filled cells, by range. A cell that does not
    continue the ground takes the mean of the cells around it.
    """
    known = np.zeros(residual_m.shape, np.bool_)
    accepted = np.zeros(residual_m.shape, np.bool_)
    grown_m = np.zeros(residual_m.shape)
    held = np.empty((2 * _WINDOW_CELLS + 1) ** 2)
    for k in range(len(outwards)):
        row, col = outwards[k]
        expected_m = _mean(held, _window(grown_m, known, row, col, held))
        known[row, col] = True
        accepted[row, col] = abs(residual_m[row, col] - expected_m) < continues_m
        grown_m[row, col] = residual_m[row, col] if accepted[row, col] else expected_m
    terrain_m = np.zeros(residual_m.shape)
    for k in range(len(outwards)):
        row, col = outwards[k]
        terrain_m[row, col] = _median(held, _window(grown_m, accepted, row, col, held))
    return terrain_m


@compiled
def _window(values: F64, usable: Mask, row: int, col: int, held: F64) -> int:
    """Fill `held` with the usable values around a cell; return how many there are."""
    count = 0
    for r in range(max(row - _WINDOW_CELLS, 0), min(row + _WINDOW_CELLS + 1, values.shape[0])):
        for c in range(max(col - _WINDOW_CELLS, 0), min(col + _WINDOW_CELLS + 1, values.shape[1])):
            if usable[r, c]:
                held[count] = values[r, c]
                count += 1
    return count


@compiled
def _mean(held: F64, count: int) -> float:
    total = 0.0
    for k in range(count):
        total += held[k]
    return total / count if count else 0.0


@compiled
def _median(held: F64, count: int) -> float:
    """Return the median, sorting in place by insertion: windows are tiny."""
    for k in range(1, count):
        value, place = held[k], k
        while place > 0 and held[place - 1] > value:
            held[place] = held[place - 1]
            place -= 1
        held[place] = value
    return held[count // 2] if count else 0.0


@compiled
def _heights(xyz_m: F32, plane: F64, terrain_m: F64, reach_m: float, cell_m: float) -> F32:
    """Return (N,) heights over the plane and the terrain of each point's cell."""
    cells = len(terrain_m)
    reach, per_cell = np.float32(reach_m), np.float32(1.0 / cell_m)
    a, b, c = np.float32(plane[0]), np.float32(plane[1]), np.float32(plane[2])
    height_m = np.empty(len(xyz_m), np.float32)
    for i in range(len(xyz_m)):
        x_m, y_m = xyz_m[i, 0], xyz_m[i, 1]
        col = min(max(int((x_m + reach) * per_cell), 0), cells - 1)
        row = min(max(int((y_m + reach) * per_cell), 0), cells - 1)
        height_m[i] = xyz_m[i, 2] - (a * x_m + b * y_m + c) - np.float32(terrain_m[row, col])
    return height_m

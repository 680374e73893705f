"""Velocity error of tracks by category (paper, section V-B, Table IV).

Every track row that was observed in its frame counts once. Its hull (or its box, where it has no
hull) is compared from above with the true boxes "at the object cluster's timestamp": the true box
it shares most area with is its object if that area is at least `significant_overlap` of the hull.
A LiDAR takes a revolution for a sweep, so a cluster may be that much older (or, where a data set
stamps a sweep at its begin, younger) than the sweep's stamp: at 6 m/s a ball's points lie up to
0.6 m from where the ball is at the stamp. Where no true box of the stamp fits, they are moved along
their velocity, by up to `revolution_s`. A track without an object stands for something unlabelled
(a guardrail, a tree): its true velocity is assumed to be zero. Rows whose object is an interpolated
true box are left out: its velocity was not observed.

The error is |v_track - v_true| over the ground, in m/s. Categories overlap:

    unlabelled tracks           tracks without an object, assumed static
    pedestrian & cyclist        the object's class is one of `vulnerable_classes`
    objects observed stationary the object's speed is at most `stationary_mps`
    slow                        speed in (stationary_mps, 3] m/s
    fast                        speed in [3, inf) m/s

Then come all rows, a row for every class, and one for the labels that no detector reports. Tracks
beyond the grid of the flow count too: they are the same for every source.

"95 % largest" is the paper's word for the upper tail; both readings are given: the mean over the
worst 5 % of the rows (at least one row) and the 95th percentile (linear interpolation).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core import SceneResult
from mottrack.core.arrays import F64, I64, Mask, Texts
from mottrack.eval.paired import WORST_SHARE
from mottrack.eval.streams import Distribution, Wanted
from mottrack.geometry.iou import bev_corners, boxes7

Polygons = NDArray[np.object_]
"""Array of shapely geometries."""
OTHER = "labels no detector reports"
UNLABELLED = "unlabelled tracks (assumed static)"
NO_OBJECT, LEFT_OUT = -1, -2
_AGES = (0.0, 0.25, -0.25, 0.5, -0.5, 0.75, -0.75, 1.0, -1.0)
"""Shares of a revolution by which a cluster is older than its stamp, the likeliest first; steps of
a quarter move a box of 20 m/s by 0.5 m, well below the size of an object that fast."""
_FRAME_SPACING_M = 1e6
"""Frames are laid side by side at this distance, farther than a scene extends, to search the
neighbours in all of them at once."""
FAST_MPS = 3.0
"""The paper's border between slow and fast objects."""
CATEGORIES = (
    UNLABELLED,
    "pedestrian & cyclist",
    "objects observed stationary",
    "slow (0, 3] m/s",
    "fast [3, inf) m/s",
)


class VelocityErrorConfig(StrictModel):
    """What counts as the same object, and as standing still."""

    significant_overlap: float = Field(
        default=0.5, gt=0, le=1, description="share of the track's hull"
    )
    revolution_s: float = Field(
        default=0.1,
        ge=0,
        le=1,
        description="revolution of the LiDAR: a cluster's time is this uncertain",
    )
    stationary_mps: float = Field(
        default=0.2, ge=0, description="speed up to which it stands still"
    )
    vulnerable_classes: tuple[str, ...] = (
        "pedestrian",
        "bicycle",
        "cyclist",
        "bicyclist",
        "wheeled_rider",
    )
    coasting: bool = Field(default=False, description="count unobserved rows of tracks too")


@dataclass(frozen=True, slots=True)
class ErrorRow:
    """One line of the table; NaN where it has no rows."""

    count: int
    mean_mps: float
    median_mps: float
    worst_mean_mps: float
    """Mean over the worst 5 % of the rows."""
    percentile_95_mps: float


# four means of nothing
NO_ROWS = ErrorRow(0, *(4 * [float("nan")]))


@dataclass(frozen=True, slots=True)
class VelocitySamples:
    """Track rows with their error, of one scene or of many."""

    error_mps: F64
    """(N,) |v_track - v_true|."""
    true_speed_mps: F64
    """(N,) 0 for a track without an object."""
    label: Texts
    """(N,) class of the object, "" for a track without one."""

    @classmethod
    def stacked(cls, parts: Sequence[VelocitySamples]) -> VelocitySamples:
        """Return the samples of all parts, in order."""
        if not parts:
            return cls(np.zeros(0), np.zeros(0), np.zeros(0, np.str_))
        columns = ("error_mps", "true_speed_mps", "label")
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in columns))


def velocity_samples(
    result: SceneResult, config: VelocityErrorConfig | None = None
) -> VelocitySamples:
    """Return the track rows of a scene that count, with their error.

    Rows without a velocity, of trackers that report none, do not count.
    """
    config = config or VelocityErrorConfig()
    tracks, truth = result.tracks, result.truth
    matched = match_by_overlap(result, config.significant_overlap, config.revolution_s)
    reported = np.isfinite(tracks.velocity_mps).all(axis=1)
    counts = (matched != LEFT_OUT) & (tracks.observed | config.coasting) & reported
    rows, objects = np.flatnonzero(counts), matched[counts]
    has = objects != NO_OBJECT
    true_velocity = np.zeros((len(rows), 2))
    true_velocity[has] = truth.velocity_mps[objects[has]]
    label = np.full(len(rows), "", dtype=truth.label.dtype if len(truth) else np.dtype("U1"))
    label[has] = truth.label[objects[has]]
    error = tracks.velocity_mps[rows] - true_velocity
    return VelocitySamples(np.hypot(*error.T), np.hypot(*true_velocity.T), label)


def match_by_overlap(
    result: SceneResult, significant_overlap: float, revolution_s: float = 0.0
) -> I64:
    """Return for every track row the row of its object in truth, NO_OBJECT or LEFT_OUT, (N,)."""
    truth = result.truth
    matched = np.full(len(result.tracks), NO_OBJECT)
    if not len(truth) or not len(matched):
        return matched
    corners = bev_corners(boxes7(truth.centre_m, truth.size_m, truth.yaw_rad))
    shift_m = revolution_s * np.nan_to_num(truth.velocity_mps)
    hulls = _hulls(result)
    near = _neighbours(result, hulls, corners, shift_m)
    for age in _AGES:
        boxes = shapely.polygons(corners[near.box] - age * shift_m[near.box, None])
        shared_m2 = shapely.area(shapely.intersection(hulls[near.row], boxes))
        share = shared_m2 / shapely.area(hulls)[near.row]
        order = np.lexsort((near.box, -share, near.row))  # of equal shares the first box
        rows, first = np.unique(near.row[order], return_index=True)
        best = order[first]
        found = share[best] >= significant_overlap
        matched[rows[found]] = near.box[best[found]]
        moves = shift_m[near.box].any(axis=1)
        near = near.select((matched[near.row] == NO_OBJECT) & np.isin(near.row, near.row[moves]))
    has = matched != NO_OBJECT
    # an interpolated box was not annotated, and NaN says that the labels hold no velocity
    unknown = truth.interpolated | np.isnan(truth.velocity_mps).any(axis=1)
    matched[has] = np.where(unknown[matched[has]], LEFT_OUT, matched[has])
    return matched


class _Neighbours(NamedTuple):
    """Pairs of a track and a true box of the same frame that may overlap."""

    row: I64
    """(P,) row of the track."""
    box: I64
    """(P,) row of the true box."""

    def select(self, mask: Mask) -> _Neighbours:
        return _Neighbours(self.row[mask], self.box[mask])


def _hulls(result: SceneResult) -> Polygons:
    """Return the hull of every track row as a polygon, that of its box where it has none, (N,)."""
    tracks = result.tracks
    boxes = bev_corners(boxes7(tracks.centre_m, tracks.size_m, tracks.yaw_rad))
    shapes = [h if len(h) >= 3 else box for h, box in zip(result.hulls, boxes, strict=True)]
    row = np.repeat(np.arange(len(shapes)), [len(shape) for shape in shapes])
    hulls: Polygons = shapely.convex_hull(shapely.multipoints(np.concatenate(shapes), indices=row))
    return hulls


def _neighbours(result: SceneResult, hulls: Polygons, corners: F64, shift_m: F64) -> _Neighbours:
    """Return the pairs whose bounding boxes meet, the true box swept by its shift either way."""
    reach_m = np.abs(shift_m)
    swept = np.hstack([corners.min(axis=1) - reach_m, corners.max(axis=1) + reach_m])
    tree = shapely.STRtree(_side_by_side(swept, result.truth.frame))
    row, box = tree.query(_side_by_side(shapely.bounds(hulls), result.tracks.frame))
    return _Neighbours(row, box).select(shapely.area(hulls)[row] > 0.0)


def _side_by_side(bounds_m: F64, frame: I64) -> Polygons:
    low_x, low_y, high_x, high_y = bounds_m.T
    offset_m = frame * _FRAME_SPACING_M
    boxes: Polygons = shapely.box(low_x + offset_m, low_y, high_x + offset_m, high_y)
    return boxes


def velocity_table(
    samples: Collection[VelocitySamples],
    config: VelocityErrorConfig | None = None,
    classes: Collection[str] = (),
) -> dict[str, ErrorRow]:
    """Return the rows of the paper's table, then "all", then a row for every class of object.

    Where `classes` are given, objects of other labels (an animal, a thrown ball: what no detector
    reports) share one row at the end.

    Args:
        samples: of each scene; read twice, and not held.
        config: what stands still, and what is vulnerable.
        classes: that a detector reports.
    """
    asked = Wanted(quantiles=(0.5, 0.95), largest_share=WORST_SHARE)
    found = error_distributions(samples, config or VelocityErrorConfig(), classes, asked)
    return {name: error_row(errors) for name, errors in found.items()}


def error_distributions(
    samples: Collection[VelocitySamples],
    config: VelocityErrorConfig,
    classes: Collection[str],
    asked: Wanted,
) -> dict[str, Distribution]:
    """Return the errors of every row of the table; arguments as of `velocity_table`."""
    found: dict[str, Distribution] = {}
    for part in (VelocitySamples.stacked([]), *samples):
        for name, mask in category_masks(part, config, classes).items():
            found.setdefault(name, Distribution(asked)).count(part.error_mps[mask])
    for part in samples:
        for name, mask in category_masks(part, config, classes).items():
            found[name].add(part.error_mps[mask])
    return {name: found[name] for name in in_order(found)}


def in_order(rows: Iterable[str]) -> list[str]:
    """Return the rows of the table in its order: categories, "all", classes, `OTHER`."""
    leading = (*CATEGORIES, "all")
    place = {name: k for k, name in enumerate(leading)} | {OTHER: len(leading) + 1}
    return sorted(set(rows), key=lambda name: (place.get(name, len(leading)), name))


def category_masks(
    samples: VelocitySamples, config: VelocityErrorConfig, classes: Collection[str] = ()
) -> dict[str, Mask]:
    """Return row of the table to the samples (N,) that belong to it."""
    speed, label = samples.true_speed_mps, samples.label
    has = label != ""
    moving = has & (speed > config.stationary_mps)
    masks = (
        ~has,
        np.isin(label, config.vulnerable_classes),
        has & (speed <= config.stationary_mps),
        moving & (speed <= FAST_MPS),
        moving & (speed >= FAST_MPS),
    )
    table = dict(zip(CATEGORIES, masks, strict=True)) | {"all": np.ones(len(label), np.bool_)}
    found = [str(name) for name in np.unique(label[has])]
    listed = [name for name in found if not classes or name in classes]
    table |= {name: label == name for name in listed}
    if len(listed) < len(found):
        table[OTHER] = has & ~np.isin(label, listed)
    return table


def error_row(errors: Distribution) -> ErrorRow:
    """Return the metrics of one set of errors."""
    if not errors.size:
        return NO_ROWS
    return ErrorRow(
        errors.size,
        errors.mean,
        errors.median,
        errors.mean_of_largest,
        errors.quantile(0.95),
    )

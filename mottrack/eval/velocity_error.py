"""Velocity error of tracks by category (paper, section V-B, Table IV).

Every track row that was observed in its frame counts once. Its hull (or its box, where it has no
hull) is compared from above with the true boxes "at the object cluster's timestamp": the true box
it shares most area with is its object if that area is at least `significant_overlap` of the hull.
A LiDAR takes a turn for a sweep, so a cluster may be that much older (or, where a data set stamps a
sweep at its begin, younger) than the sweep's stamp: at 6 m/s a ball's points lie up to 0.6 m from
where the ball is at the stamp. Where no true box of the stamp fits, they are looked at along their
motion, up to `turn_s` away. A track without an
object stands for something nobody labelled (a guardrail, a tree): its true velocity is zero. Rows
whose object is an interpolated true box are left out: its velocity was not observed.

The error is |v_track - v_true| over the ground, in m/s. Categories overlap:

    static objects              tracks without an object
    pedestrian & cyclist        the object's class is one of `vulnerable_classes`
    objects observed stationary the object's speed is at most `stationary_mps`
    slow                        speed in (stationary_mps, 3] m/s
    fast                        speed in [3, inf) m/s

Then come all rows, a row for every class, and one for the labels that no detector reports. Tracks
beyond the grid of the flow count too: they are the same for every source.

"95 % largest" is the paper's word for the bad end; both readings are given: the mean over the worst
5 % of the rows (at least one row) and the 95th percentile (linear interpolation).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core import SceneResult
from mottrack.core.arrays import F64, I64, Mask, Texts
from mottrack.core.tables import TruthTable
from mottrack.geometry.iou import bev_corners, boxes7
from mottrack.geometry.polygon import polygon_area, shared_areas

OTHER = "labels no detector reports"
NO_OBJECT, LEFT_OUT = -1, -2
_AGES = (0.0, 0.25, -0.25, 0.5, -0.5, 0.75, -0.75, 1.0, -1.0)
"""Shares of a turn by which a cluster is older than its stamp, the likeliest first."""
FAST_MPS = 3.0
CATEGORIES = (
    "static objects",
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
    turn_s: float = Field(
        default=0.1, ge=0, le=1, description="turn of the LiDAR: a cluster's time is this uncertain"
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
        """The samples of all parts, in order."""
        if not parts:
            return cls(np.zeros(0), np.zeros(0), np.zeros(0, np.str_))
        columns = ("error_mps", "true_speed_mps", "label")
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in columns))


def velocity_samples(
    result: SceneResult, config: VelocityErrorConfig | None = None
) -> VelocitySamples:
    """The track rows of a scene that count, with their error."""
    config = config or VelocityErrorConfig()
    tracks, truth = result.tracks, result.truth
    matched = match_by_overlap(result, config.significant_overlap, config.turn_s)
    counts = (matched != LEFT_OUT) & (tracks.observed | config.coasting)
    rows, objects = np.flatnonzero(counts), matched[counts]
    has = objects != NO_OBJECT
    true_velocity = np.zeros((len(rows), 2))
    true_velocity[has] = truth.velocity_mps[objects[has]]
    label = np.full(len(rows), "", dtype=truth.label.dtype if len(truth) else np.dtype("U1"))
    label[has] = truth.label[objects[has]]
    error = tracks.velocity_mps[rows] - true_velocity
    return VelocitySamples(_length(error), _length(true_velocity), label)


def match_by_overlap(result: SceneResult, significant_overlap: float, turn_s: float = 0.0) -> I64:
    """(N,) for every track row the row of its object in truth, NO_OBJECT or LEFT_OUT."""
    tracks, truth = result.tracks, result.truth
    matched = np.full(len(tracks), NO_OBJECT)
    if not len(truth):
        return matched
    corners = bev_corners(boxes7(truth.centre_m, truth.size_m, truth.yaw_rad))
    boxes = bev_corners(boxes7(tracks.centre_m, tracks.size_m, tracks.yaw_rad))
    candidates = _rows_by_frame(truth, len(result.frames))
    velocity_mps = np.nan_to_num(truth.velocity_mps)
    reach = np.hypot(truth.size_m[:, 0], truth.size_m[:, 1]) / 2
    reach += turn_s * _length(velocity_mps)
    shift_m = turn_s * velocity_mps
    for row, hull in enumerate(result.hulls if len(tracks) else ()):
        shape = hull if len(hull) >= 3 else boxes[row]
        near = _near(candidates[tracks.frame[row]], shape, truth.centre_m[:, :2], reach)
        matched[row] = _object_of(shape, near, (corners, shift_m), significant_overlap)
    has = matched != NO_OBJECT
    # nobody annotated an interpolated box, and a NaN says that the labels tell no velocity
    untold = truth.interpolated | np.isnan(truth.velocity_mps).any(axis=1)
    matched[has] = np.where(untold[matched[has]], LEFT_OUT, matched[has])
    return matched


def _rows_by_frame(truth: TruthTable, frames: int) -> list[I64]:
    order = np.argsort(truth.frame, kind="stable")
    return np.split(order, np.searchsorted(truth.frame[order], np.arange(1, frames)))


def _near(candidates: I64, shape: F64, centre_xy_m: F64, reach_m: F64) -> I64:
    """The candidates whose circumscribed circle reaches that of the shape."""
    middle = shape.mean(axis=0)
    radius = np.sqrt(((shape - middle) ** 2).sum(axis=1).max())
    apart = _length(centre_xy_m[candidates] - middle)
    near: I64 = candidates[apart <= reach_m[candidates] + radius]
    return near


def _object_of(shape: F64, near: I64, boxes: tuple[F64, F64], significant_overlap: float) -> int:
    """The box that shares enough area with the shape, at the time nearest to the stamp.

    `boxes` are the corners (K, 4, 2) and how far each moves in a turn (K, 2).
    """
    area = abs(polygon_area(shape))
    if area <= 0.0 or not len(near):
        return NO_OBJECT
    corners, shift_m = boxes
    for age in _AGES if shift_m[near].any() else _AGES[:1]:
        shares = shared_areas(shape, corners[near] - age * shift_m[near, None]) / area
        best = int(np.argmax(shares))
        if shares[best] >= significant_overlap:
            return int(near[best])
    return NO_OBJECT


def velocity_table(
    samples: Iterable[VelocitySamples],
    config: VelocityErrorConfig | None = None,
    classes: Collection[str] = (),
) -> dict[str, ErrorRow]:
    """The rows of the paper's table, then "all", then a row for every class of object.

    Where `classes` are given, objects of other labels (an animal, a thrown ball: what no detector
    reports) share one row at the end.
    """
    together = VelocitySamples.stacked(list(samples))
    masks = category_masks(together, config or VelocityErrorConfig(), classes)
    return {name: error_row(together.error_mps[mask]) for name, mask in masks.items()}


def category_masks(
    samples: VelocitySamples, config: VelocityErrorConfig, classes: Collection[str] = ()
) -> dict[str, Mask]:
    """Row of the table to the samples (N,) that belong to it."""
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


def error_row(error_mps: F64) -> ErrorRow:
    """The figures of one set of errors (N,)."""
    if not len(error_mps):
        return NO_ROWS
    worst = np.sort(error_mps)[-max(1, round(0.05 * len(error_mps))) :]
    return ErrorRow(
        len(error_mps),
        float(error_mps.mean()),
        float(np.median(error_mps)),
        float(worst.mean()),
        float(np.quantile(error_mps, 0.95)),
    )


def _length(xy: F64) -> F64:
    return np.hypot(xy[:, 0], xy[:, 1])

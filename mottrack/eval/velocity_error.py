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

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core import SceneResult
from mottrack.core.arrays import F64, I64, Mask, Texts
from mottrack.eval.overlap import (
    NO_OBJECT,
    Outlines,
    TrueBoxes,
    best_overlaps,
    box_corners,
    rectangles,
)
from mottrack.eval.paired import WORST_SHARE
from mottrack.eval.streams import Distribution, Wanted
from mottrack.geometry.hulls import hulls_of_groups

OTHER = "labels no detector reports"
UNLABELLED = "unlabelled tracks (assumed static)"
LEFT_OUT = -2
"""Of a track whose true box has no velocity that was observed."""
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
    return samples_of(tracks.velocity_mps[counts], matched[counts], truth.velocity_mps, truth.label)


def samples_of(
    velocity_mps: F64, matched: I64, true_velocity_mps: F64, true_label: Texts
) -> VelocitySamples:
    """Return the errors of track rows.

    Args:
        velocity_mps: (N, 2) of the tracks.
        matched: (N,) row of each one's object, or NO_OBJECT.
        true_velocity_mps: (M, 2) of the objects.
        true_label: (M,) their classes.
    """
    has = matched != NO_OBJECT
    true_velocity = np.zeros((len(matched), 2))
    true_velocity[has] = true_velocity_mps[matched[has]]
    label = np.full(len(matched), "", dtype=true_label.dtype if len(true_label) else "U1")
    label[has] = true_label[matched[has]]
    error = velocity_mps - true_velocity
    return VelocitySamples(np.hypot(*error.T), np.hypot(*true_velocity.T), label)


def match_by_overlap(
    result: SceneResult, significant_overlap: float, revolution_s: float = 0.0
) -> I64:
    """Return for every track row the row of its object in truth, NO_OBJECT or LEFT_OUT, (N,)."""
    truth = result.truth
    order = np.argsort(truth.frame, kind="stable")
    boxes = TrueBoxes(
        box_corners(truth.centre_m, truth.size_m, truth.yaw_rad)[order],
        truth.frame[order],
        revolution_s * np.nan_to_num(truth.velocity_mps)[order],
    )
    matched = best_overlaps(_outlines(result), boxes, significant_overlap)
    has = matched != NO_OBJECT
    matched[has] = order[matched[has]]
    # an interpolated box was not annotated, and NaN says that the labels hold no velocity
    unknown = truth.interpolated | np.isnan(truth.velocity_mps).any(axis=1)
    matched[has] = np.where(unknown[matched[has]], LEFT_OUT, matched[has])
    return matched


def _outlines(result: SceneResult) -> Outlines:
    """Return the hull of every track row, that of its box where it has none."""
    tracks = result.tracks
    corners = box_corners(tracks.centre_m, tracks.size_m, tracks.yaw_rad)
    if not tracks.hull_corners.any():
        return rectangles(corners, tracks.frame)
    shapes = [h if len(h) >= 3 else box for h, box in zip(result.hulls, corners, strict=True)]
    start = np.cumsum([0, *(len(shape) for shape in shapes)])
    hulls = hulls_of_groups(np.concatenate(shapes), start)
    return Outlines(hulls.corner_m, hulls.start, tracks.frame)


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

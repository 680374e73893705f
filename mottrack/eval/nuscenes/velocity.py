"""Velocity error of a nuScenes submission, anybody's, by category (paper, section V-B)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from mottrack.core.arrays import F64, Mask
from mottrack.eval.nuscenes.boxes import Bodies, GroundTruth
from mottrack.eval.overlap import (
    NO_OBJECT,
    TrueBoxes,
    best_overlaps,
    box_corners,
    rectangles,
)
from mottrack.eval.paired import CONFIDENCE, RESAMPLES, PairedDifference, draw, paired_all, sample
from mottrack.eval.velocity_error import (
    VelocityErrorConfig,
    VelocitySamples,
    samples_of,
    velocity_table,
)
from mottrack.formats.text_table import aligned

COLUMNS = ("mean", "median", "worst 5 %", "rows")


@dataclass(frozen=True, slots=True)
class SubmissionErrors:
    """Velocity errors of one submission."""

    path: Path
    scenes: Sequence[VelocitySamples]
    """Of each scene."""
    unknown: int
    """Boxes that are left out because their velocity is NaN."""
    all_zero: bool
    """Whether every known velocity is exactly zero: the tracker gives none."""


def submission_errors(path: Path, tracks: Bodies, truth: GroundTruth) -> SubmissionErrors:
    """Return the velocity error of every box of a submission, scene by scene.

    A submission does not tell coasted boxes from observed ones, so all count.

    Args:
        path: the file, for messages.
        tracks: its boxes.
        truth: of the split.
    """
    config, bodies = VelocityErrorConfig(), truth.bodies
    shift_m = config.revolution_s * np.nan_to_num(bodies.velocity_mps)
    boxes = TrueBoxes(_corners(bodies), bodies.sample, shift_m)
    outlines = rectangles(_corners(tracks), tracks.sample)
    matched = best_overlaps(outlines, boxes, config.significant_overlap)
    known: Mask = np.asarray(np.isfinite(tracks.velocity_mps).all(axis=1))
    counts: Mask = known & _observed(bodies)[matched]
    ends = np.searchsorted(tracks.sample, truth.samples.first)
    scenes: list[VelocitySamples] = []
    for start, end in pairwise(ends):
        rows = start + np.flatnonzero(counts[start:end])
        velocity_mps, objects = tracks.velocity_mps[rows], matched[rows]
        first, last = np.searchsorted(bodies.sample, truth.samples.first[len(scenes) :][:2])
        here = slice(first, last)
        label = bodies.names[bodies.label[here]]
        objects = np.where(objects == NO_OBJECT, NO_OBJECT, objects - first)
        scenes.append(samples_of(velocity_mps, objects, bodies.velocity_mps[here], label))
    all_zero = bool(known.any() and not tracks.velocity_mps[known].any())
    return SubmissionErrors(path, scenes, int(np.count_nonzero(~known)), all_zero)


def _corners(bodies: Bodies) -> F64:
    return box_corners(bodies.bev[:, :2], bodies.bev[:, 2:4], bodies.bev[:, 4])


def _observed(bodies: Bodies) -> Mask:
    """Return of which true boxes the velocity is known; one element more for `NO_OBJECT`."""
    known: Mask = np.append(np.isfinite(bodies.velocity_mps).all(axis=1), np.True_)
    return known


def velocity_content(errors: SubmissionErrors, classes: Sequence[str]) -> dict[str, Any]:
    """Return the rows of the paper's table as plain data."""
    table = velocity_table([VelocitySamples.stacked(errors.scenes)], classes=classes)
    return {name: asdict(row) for name, row in table.items()}


def velocity_text(errors: SubmissionErrors, content: dict[str, Any]) -> Iterator[str]:
    """Yield the table, before it how many boxes are left out."""
    yield from unknown_text(errors)
    columns = ("mean_mps", "median_mps", "worst_mean_mps")
    rows = [
        [name, *(_number(row[column]) for column in columns), str(row["count"])]
        for name, row in content.items()
    ]
    yield f"velocity error of the tracks, m/s\n{aligned([['tracks', *COLUMNS], *rows])}"


def unknown_text(errors: SubmissionErrors) -> Iterator[str]:
    """Yield how many boxes are left out, if any, and whether no velocity was given."""
    if errors.unknown:
        yield f"{errors.path.name}: {errors.unknown} boxes have no velocity (NaN) and are left out"
    if errors.all_zero:
        yield (
            f"{errors.path.name}: the velocity of every box is 0 (not measured?), so each error "
            "is the object's own speed"
        )


def velocity_differences(
    first: SubmissionErrors, second: SubmissionErrors, classes: Sequence[str]
) -> tuple[PairedDifference, ...]:
    """Return mean and tail of the second less those of the first, with intervals over scenes."""
    # needs scipy, slow to import
    from mottrack.eval.run_metrics import velocity_metrics

    weights = draw(len(first.scenes), RESAMPLES)
    config = VelocityErrorConfig()
    sampled = [
        {
            key: sample(metric, weights)
            for key, metric in velocity_metrics(side.scenes, config, classes, weights)
        }
        for side in (first, second)
    ]
    return paired_all(sampled[0], sampled[1])


def comparison_text(found: Sequence[PairedDifference]) -> str:
    """Return the table of the differences."""
    rows = [
        [f"{d.key.row}, {d.key.metric}", _number(d.baseline), _number(d.value), _interval(d)]
        for d in found
    ]
    title = f"velocity error, difference to the first submission, {CONFIDENCE:.0%} intervals"
    head = ["tracks", "first", "second", "difference"]
    return f"{title}; *: significant\n{aligned([head, *rows])}"


def _interval(found: PairedDifference) -> str:
    if np.isnan(found.low):
        return f"{found.difference:+.3f} (one scene)"
    mark = "*" if found.significant else ""
    return f"{found.difference:+.3f} [{found.low:+.3f}, {found.high:+.3f}]{mark}"


def _number(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.3f}"

"""Calibration of scores: of the boxes with a score of 0.7, are 7 of 10 an object?

Guo et al., 2017: boxes are put into bins by their score, and the expected calibration error is the
mean over the boxes of |share that is right - mean score| of their bin.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.eval import clear
from mottrack.eval.arithmetic import ratio
from mottrack.eval.paired import Ratio, Sampled, sample
from mottrack.eval.pairs import BoxStream, centre_distance, find_pairs
from mottrack.eval.tracked_scenes import TrackedScenes

BINS = 10
"""Of equal width in [0, 1], as is usual."""
ALL = "all"


class Bin(NamedTuple):
    """The track boxes whose score lies in one bin."""

    low: float
    high: float
    boxes: int
    score: float
    """Their mean score; NaN where there is none."""
    right: Sampled
    """Share of them that are matched with a true box."""


@dataclass(frozen=True)
class Calibration:
    """How far the scores of one class can be believed."""

    label: str
    """The class; "all" for all together."""
    boxes: int
    bins: tuple[Bin, ...]
    error: Sampled
    """Expected calibration error; lower is better."""


class Scored(NamedTuple):
    """N track boxes of one scene: their scores, and which are right."""

    score: F64
    right: Mask


def calibrations(scenes: TrackedScenes, weights: I64) -> list[Calibration] | str:
    """Return the calibration of all classes together, then of each; or why there is none.

    Every track box counts, whatever its score: it is right if CLEAR matches it with a true box of
    its class.

    Args:
        scenes: truth and tracks.
        weights: (B, S) how often each scene counts in each resample.
    """
    labels = [one.label or ALL for one in scenes.unfiltered]
    rows = [
        [scored_boxes(scenes, index, k) for k in range(len(labels))]
        for index in range(len(scenes.results))
    ]
    of_class = {label: [row[k] for row in rows] for k, label in enumerate(labels)}
    every = [
        Scored(*(np.concatenate(column) for column in zip(*parts, strict=True)))
        for parts in zip(*of_class.values(), strict=True)
    ]
    scores = np.concatenate([part.score for part in every] or [np.zeros(0)])
    if not len(scores):
        return "there is no track box"
    if scores.min() < 0.0 or scores.max() > 1.0:
        return f"scores of {scores.min():g} to {scores.max():g} are no probabilities"
    if scores.min() == scores.max():
        return f"every track box has the score {scores[0]:g}"
    listed = {ALL: every, **of_class}
    return [
        calibration(label, parts, weights)
        for label, parts in listed.items()
        if any(len(part.score) for part in parts)
    ]


def scored_boxes(scenes: TrackedScenes, index: int, class_index: int) -> Scored:
    """Return the track boxes of one class in a scene and whether each is matched."""
    result, distance_m = scenes.part(index), scenes.config.match_distance_m
    truth, tracks = scenes.boxes(index, scenes.unfiltered[class_index])
    pairs = find_pairs(
        BoxStream(truth.frame, truth.id),
        BoxStream(tracks.frame, tracks.id),
        len(result.frames),
        centre_distance(truth.centre_m, tracks.centre_m, distance_m),
    )
    found = clear.associate(pairs.within(distance_m))
    right = np.zeros(len(tracks), np.bool_)
    right[found.track_row[found.track_row >= 0]] = True
    return Scored(tracks.score, right)


def calibration(label: str, scenes: Sequence[Scored], weights: I64) -> Calibration:
    """Return the reliability diagram and the expected calibration error of scored boxes.

    >>> sure = Scored(np.array([0.9, 0.9]), np.array([True, False]))
    >>> round(calibration("car", [sure], np.ones((1, 1), np.int64)).error.value, 3)
    0.4
    """
    sums = np.array([_sums(part) for part in scenes])
    draws = expected_error(np.tensordot(weights.astype(np.float64), sums, axes=1))
    whole = sums.sum(axis=0)
    present = sums[:, 0].sum(axis=1) > 0
    error = Sampled(float(expected_error(whole[None])[0]), draws, present)
    return Calibration(label, int(whole[0].sum()), tuple(_bins(sums, weights)), error)


def _sums(part: Scored) -> F64:
    """Return boxes, right ones and scores by bin, (3, BINS)."""
    place = np.clip((part.score * BINS).astype(np.int64), 0, BINS - 1)
    columns = (np.ones(len(place)), part.right.astype(np.float64), part.score)
    return np.stack([np.bincount(place, column, BINS) for column in columns])


def expected_error(sums: F64) -> F64:
    """Return the expected calibration error of sums (B, 3, bins), NaN without a box, (B,)."""
    boxes, right, scores = np.moveaxis(sums, 1, 0)
    error: F64 = ratio(np.abs(right - scores).sum(axis=1), boxes.sum(axis=1))
    return error


def _bins(sums: F64, weights: I64) -> Iterator[Bin]:
    for k in range(BINS):
        boxes, right, scores = sums[:, :, k].T
        mean = ratio(float(scores.sum()), float(boxes.sum()))
        shares = sample(Ratio(right, boxes), weights)
        yield Bin(k / BINS, (k + 1) / BINS, int(boxes.sum()), mean, shares)

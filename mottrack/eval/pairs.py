"""Candidate pairs of true and tracked boxes, found once for CLEAR, identity and HOTA."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.core.errors import InputError


@dataclass(frozen=True, slots=True)
class BoxStream:
    """Boxes of a sequence, true or tracked, in order of their frame."""

    frame: I64
    """(N,) index of the frame."""
    id: I64
    """(N,) identity."""

    def __post_init__(self) -> None:
        if len(self.frame) != len(self.id):
            raise InputError("length of id", len(self.id), f"{len(self.frame)}, one per box")
        if (np.diff(self.frame) < 0).any():
            raise InputError("frame", "not in order", "boxes sorted by frame")

    def __len__(self) -> int:
        return len(self.frame)

    def dense_ids(self) -> I64:
        """Return the identities renumbered from 0, (N,)."""
        return np.unique(self.id, return_inverse=True)[1]

    def edges(self, frames: int) -> I64:
        """Return the first row of each frame, and the end, (frames + 1,)."""
        return np.searchsorted(self.frame, np.arange(frames + 1))


class FrameRows(NamedTuple):
    """The rows of one frame in the tables of a sequence."""

    truth: slice
    tracks: slice
    pairs: slice


@dataclass(frozen=True, slots=True)
class Pairs:
    """The pairs of one sequence that are near enough to be matched."""

    truth: BoxStream
    tracks: BoxStream
    frames: int
    """Number of frames of the sequence."""
    truth_row: I64
    """(P,) row in `truth`, ascending."""
    track_row: I64
    """(P,) row in `tracks`."""
    distance: F64
    """(P,) metres between the centres, or 1 - IoU."""
    similarity: F64
    """(P,) in [0, 1]: 1 where both boxes agree, 0 where they have nothing in common."""

    def within(self, gate: float) -> Pairs:
        """Return the pairs whose distance is below the gate."""
        keep = self.distance < gate
        return replace(
            self,
            truth_row=self.truth_row[keep],
            track_row=self.track_row[keep],
            distance=self.distance[keep],
            similarity=self.similarity[keep],
        )

    def by_frame(self) -> Iterator[FrameRows]:
        """Yield the rows of every frame."""
        truth_edges = self.truth.edges(self.frames)
        pair_edges = np.searchsorted(self.truth_row, truth_edges)
        edges = np.stack([truth_edges, self.tracks.edges(self.frames), pair_edges], axis=1)
        for first, end in pairwise(edges.tolist()):
            yield FrameRows(*map(slice, first, end))

    def matrix(self, rows: FrameRows, values: F64, missing: float) -> F64:
        """Lay the values (P,) of one frame out as a matrix (true boxes, track boxes)."""
        shape = (rows.truth.stop - rows.truth.start, rows.tracks.stop - rows.tracks.start)
        dense = np.full(shape, missing)
        i = self.truth_row[rows.pairs] - rows.truth.start
        dense[i, self.track_row[rows.pairs] - rows.tracks.start] = values[rows.pairs]
        return dense


class Measured(NamedTuple):
    """How far apart the boxes of one frame are."""

    distance: F64
    """(true boxes, track boxes) metres, or 1 - IoU."""
    similarity: F64
    """(true boxes, track boxes) in [0, 1]."""


Measure = Callable[[slice, slice], Measured]
"""Measures the boxes of one frame, given their rows in truth and in tracks."""


def find_pairs(truth: BoxStream, tracks: BoxStream, frames: int, measure: Measure) -> Pairs:
    """List all pairs of the same frame with a similarity above zero."""
    none = np.zeros(0, np.int64)
    pairs = Pairs(truth, tracks, frames, none, none, np.zeros(0), np.zeros(0))
    truth_row, track_row, distance, similarity = [none], [none], [np.zeros(0)], [np.zeros(0)]
    for rows in pairs.by_frame():
        if rows.truth.start == rows.truth.stop or rows.tracks.start == rows.tracks.stop:
            continue
        measured = measure(rows.truth, rows.tracks)
        i, j = np.nonzero(measured.similarity > 0.0)
        truth_row.append(i + rows.truth.start)
        track_row.append(j + rows.tracks.start)
        distance.append(measured.distance[i, j])
        similarity.append(measured.similarity[i, j])
    return replace(
        pairs,
        truth_row=np.concatenate(truth_row),
        track_row=np.concatenate(track_row),
        distance=np.concatenate(distance),
        similarity=np.concatenate(similarity),
    )


def centre_distance(truth_xy_m: F64, tracks_xy_m: F64, zero_m: float) -> Measure:
    """Measure the distance of the centres over the ground.

    Args:
        truth_xy_m: (G, >= 2) centres of the true boxes; further columns are not used.
        tracks_xy_m: (P, >= 2) centres of the track boxes, same frame.
        zero_m: distance at which the similarity, which falls linearly from 1, reaches 0.
    """

    def measure(rows: slice, columns: slice) -> Measured:
        apart = truth_xy_m[rows, None, :2] - tracks_xy_m[None, columns, :2]
        distance = np.hypot(apart[..., 0], apart[..., 1])
        return Measured(distance, np.maximum(0.0, 1.0 - distance / zero_m))

    return measure


def overlap(iou: Callable[[F64, F64], F64], truth_boxes: F64, track_boxes: F64) -> Measure:
    """Measure the overlap of boxes of any kind: similarity is their `iou`, distance 1 - IoU."""

    def measure(rows: slice, columns: slice) -> Measured:
        similarity = iou(truth_boxes[rows], track_boxes[columns])
        return Measured(1.0 - similarity, similarity)

    return measure


def iou_gate(min_iou: float) -> float:
    """Return the distance 1 - IoU below which boxes of at least this IoU lie."""
    return float(np.nextafter(1.0 - min_iou, 2.0))

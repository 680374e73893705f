"""Candidate pairs of true and tracked boxes, found once for CLEAR, identity and HOTA."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.errors import InputError
from mottrack.eval.assignment import DENSE

_CHUNK = 50_000
"""Pairs of small frames that are measured together: their arrays stay in the processor's cache."""
_STRIP = 64
"""True boxes of a crowd that are measured together: with their neighbours a small matrix."""


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
        return self._kept(self.distance < gate)

    def similar(self, least: float) -> Pairs:
        """Return the pairs of at least this similarity."""
        return self._kept(self.similarity >= least)

    def _kept(self, keep: Mask) -> Pairs:
        return replace(
            self,
            truth_row=self.truth_row[keep],
            track_row=self.track_row[keep],
            distance=self.distance[keep],
            similarity=self.similarity[keep],
        )

    def of_tracks(self, chosen: Mask) -> Pairs:
        """Return the same sequence with only the chosen track boxes, (boxes of tracks,)."""
        keep = chosen[self.track_row]
        row = np.cumsum(chosen) - 1
        return replace(
            self,
            tracks=BoxStream(self.tracks.frame[chosen], self.tracks.id[chosen]),
            truth_row=self.truth_row[keep],
            track_row=row[self.track_row[keep]],
            distance=self.distance[keep],
            similarity=self.similarity[keep],
        )

    @property
    def frame(self) -> I64:
        """(P,) frame of each pair."""
        return self.truth.frame[self.truth_row]

    def plain_frames(self) -> Mask:
        """Return in which frames no box has two pairs: all of them are matches, (frames,)."""
        plain = np.ones(self.frames, np.bool_)
        for row in (self.truth_row, self.track_row):
            plain[self.frame[np.bincount(row)[row] > 1]] = False
        return plain

    def by_frame(self, chosen: I64 | None = None) -> Iterator[FrameRows]:
        """Yield the rows of every frame, or of the chosen ones."""
        truth_edges = self.truth.edges(self.frames)
        pair_edges = np.searchsorted(self.truth_row, truth_edges)
        edges = np.stack([truth_edges, self.tracks.edges(self.frames), pair_edges], axis=1)
        which = np.arange(self.frames) if chosen is None else chosen
        for first, end in zip(edges[which].tolist(), edges[which + 1].tolist(), strict=True):
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


Rows = slice | I64
"""Rows of a table."""


class Measure(NamedTuple):
    """Measures boxes of one frame."""

    between: Callable[[Rows, Rows], Measured]
    """Given rows in truth and in tracks, of all pairs of them."""
    truth_span: F64
    """(G, 2) along the first axis: boxes whose spans do not meet have similarity 0."""
    track_span: F64
    """(P, 2)"""
    each: Callable[[I64, I64], Measured] | None = None
    """The same of single pairs, row by row; None where there is no quicker way."""


def find_pairs(truth: BoxStream, tracks: BoxStream, frames: int, measure: Measure) -> Pairs:
    """List all pairs of the same frame with a similarity above zero."""
    none = np.zeros(0, np.int64)
    pairs = Pairs(truth, tracks, frames, none, none, np.zeros(0), np.zeros(0))
    sizes = np.diff(truth.edges(frames)) * np.diff(tracks.edges(frames))
    alone = np.flatnonzero(sizes > (0 if measure.each is None else DENSE))
    found = [_Found(none, none, np.zeros(0), np.zeros(0))]
    for rows in pairs.by_frame(alone):
        found += _pairs_of_frame(rows, measure)
    if measure.each is not None:
        small = np.flatnonzero((sizes > 0) & (sizes <= DENSE))
        for chunk in np.split(
            small, np.flatnonzero(np.diff(np.cumsum(sizes[small]) // _CHUNK)) + 1
        ):
            found.append(_pairs_of_frames(pairs, chunk, measure, measure.each))
    truth_row, track_row, distance, similarity = map(np.concatenate, zip(*found, strict=True))
    order = np.lexsort((track_row, truth_row))
    return replace(
        pairs,
        truth_row=truth_row[order],
        track_row=track_row[order],
        distance=distance[order],
        similarity=similarity[order],
    )


class _Found(NamedTuple):
    truth_row: I64
    track_row: I64
    distance: F64
    similarity: F64


def _pairs_of_frames(
    pairs: Pairs, chosen: I64, measure: Measure, each: Callable[[I64, I64], Measured]
) -> _Found:
    """Return the pairs of many small frames, measured all at once."""
    first, end = pairs.truth.edges(pairs.frames), pairs.tracks.edges(pairs.frames)
    wide, start = np.diff(end)[chosen], end[:-1][chosen]
    sizes = np.diff(first)[chosen] * wide
    within = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    i, j = np.divmod(within, np.repeat(wide, sizes))
    i, j = i + np.repeat(first[:-1][chosen], sizes), j + np.repeat(start, sizes)
    (left, right), (low, high) = measure.truth_span.T, measure.track_span.T
    meet = (low[j] <= right[i]) & (high[j] >= left[i])
    i, j = i[meet], j[meet]
    measured = each(i, j)
    near = measured.similarity > 0.0
    return _Found(i[near], j[near], measured.distance[near], measured.similarity[near])


def _pairs_of_frame(rows: FrameRows, measure: Measure) -> Iterator[_Found]:
    """Yield the pairs of a frame, of a crowd strip by strip along the first axis."""
    i, j = np.arange(rows.truth.start, rows.truth.stop), np.arange(*_ends(rows.tracks))
    if len(i) * len(j) <= DENSE:
        yield _measured(i, j, measure.between(rows.truth, rows.tracks))
        return
    i = i[np.argsort(measure.truth_span[i, 0], kind="stable")]
    low, high = measure.track_span[j].T
    for strip in np.array_split(i, len(i) // _STRIP + 1):
        left, right = measure.truth_span[strip, 0].min(), measure.truth_span[strip, 1].max()
        near = j[(low <= right) & (high >= left)]
        yield _measured(strip, near, measure.between(strip, near))


def _ends(rows: slice) -> tuple[int, int]:
    return rows.start, rows.stop


def _measured(truth_row: I64, track_row: I64, measured: Measured) -> _Found:
    i, j = np.nonzero(measured.similarity > 0.0)
    return _Found(truth_row[i], track_row[j], measured.distance[i, j], measured.similarity[i, j])


def centre_distance(truth_xy_m: F64, tracks_xy_m: F64, zero_m: float) -> Measure:
    """Measure the distance of the centres over the ground.

    Args:
        truth_xy_m: (G, >= 2) centres of the true boxes; further columns are not used.
        tracks_xy_m: (P, >= 2) centres of the track boxes, same frame.
        zero_m: distance at which the similarity, which falls linearly from 1, reaches 0.
    """

    def measured(apart: F64) -> Measured:
        distance = np.hypot(apart[..., 0], apart[..., 1])
        return Measured(distance, np.maximum(0.0, 1.0 - distance / zero_m))

    def between(rows: Rows, columns: Rows) -> Measured:
        return measured(truth_xy_m[rows][:, None, :2] - tracks_xy_m[columns][None, :, :2])

    def each(rows: I64, columns: I64) -> Measured:
        return measured(truth_xy_m[rows, :2] - tracks_xy_m[columns, :2])

    reach = np.array([-zero_m, zero_m])
    spans = truth_xy_m[:, :1] + reach, tracks_xy_m[:, :1] + 0.0 * reach
    return Measure(between, *spans, each)


def overlap(
    iou: Callable[[F64, F64], F64],
    truth: Extended,
    tracks: Extended,
    iou_of_pairs: Callable[[F64, F64], F64] | None = None,
) -> Measure:
    """Measure the overlap of boxes of any kind: similarity is their `iou`, distance 1 - IoU.

    Args:
        iou: of all pairs of two sets of boxes, as a matrix.
        truth: the true boxes.
        tracks: the boxes of tracks.
        iou_of_pairs: the same of single pairs, where there is such a function.
    """

    def measured(similarity: F64) -> Measured:
        return Measured(1.0 - similarity, similarity)

    def between(rows: Rows, columns: Rows) -> Measured:
        return measured(iou(truth.boxes[rows], tracks.boxes[columns]))

    if iou_of_pairs is None:
        return Measure(between, truth.span, tracks.span)
    return Measure(
        between,
        truth.span,
        tracks.span,
        lambda i, j: measured(iou_of_pairs(truth.boxes[i], tracks.boxes[j])),
    )


class Extended(NamedTuple):
    """Boxes, and where they lie along the first axis."""

    boxes: F64
    """(N, K) as the overlap wants them."""
    span: F64
    """(N, 2) from where to where."""


def iou_gate(min_iou: float) -> float:
    """Return the distance 1 - IoU below which boxes of at least this IoU lie."""
    return float(np.nextafter(1.0 - min_iou, 2.0))

"""Candidate pairs of true and tracked boxes: found once, used by CLEAR, identity and HOTA alike."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.core.errors import InputError


@dataclass(frozen=True, slots=True)
class BoxStream:
    """Boxes of one side (truth or tracks) of a sequence, in order of their frame."""

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
        """(N,) the identities renumbered from 0."""
        return np.unique(self.id, return_inverse=True)[1].astype(np.int64)

    def edges(self, frames: int) -> I64:
        """(frames + 1,) first row of each frame, and the end."""
        return np.searchsorted(self.frame, np.arange(frames + 1)).astype(np.int64)


@dataclass(frozen=True, slots=True)
class Pairs:
    """The pairs of one sequence that are near enough to matter."""

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

    def within(self, gate: float) -> "Pairs":
        """The pairs whose distance is below the gate."""
        keep = self.distance < gate
        return replace(
            self,
            truth_row=self.truth_row[keep],
            track_row=self.track_row[keep],
            distance=self.distance[keep],
            similarity=self.similarity[keep],
        )

    def by_frame(self) -> Iterator[tuple[slice, slice, slice]]:
        """Per frame the rows of truth, of tracks and of pairs."""
        truth_edges = self.truth.edges(self.frames)
        track_edges = self.tracks.edges(self.frames)
        pair_edges = np.searchsorted(self.truth_row, truth_edges)
        for f in range(self.frames):
            yield (
                slice(int(truth_edges[f]), int(truth_edges[f + 1])),
                slice(int(track_edges[f]), int(track_edges[f + 1])),
                slice(int(pair_edges[f]), int(pair_edges[f + 1])),
            )


def find_pairs(
    truth: BoxStream,
    tracks: BoxStream,
    frames: int,
    measure: Callable[[slice, slice], tuple[F64, F64]],
) -> Pairs:
    """All pairs of the same frame with a similarity above zero.

    `measure(truth rows, track rows)` returns the distances and the similarities of one frame, each
    (truth rows, track rows).
    """
    truth_edges, track_edges = truth.edges(frames), tracks.edges(frames)
    found: list[tuple[I64, I64, F64, F64]] = []
    for f in range(frames):
        rows = slice(int(truth_edges[f]), int(truth_edges[f + 1]))
        columns = slice(int(track_edges[f]), int(track_edges[f + 1]))
        if rows.start == rows.stop or columns.start == columns.stop:
            continue
        distance, similarity = measure(rows, columns)
        i, j = np.nonzero(similarity > 0.0)
        found.append((i + rows.start, j + columns.start, distance[i, j], similarity[i, j]))
    if not found:
        none = np.zeros(0, np.int64)
        return Pairs(truth, tracks, frames, none, none, np.zeros(0), np.zeros(0))
    row, column, distance, similarity = (
        np.concatenate([part[k] for part in found]) for k in range(4)
    )
    return Pairs(truth, tracks, frames, row, column, distance, similarity)


def centre_distance(
    truth_xy_m: F64, tracks_xy_m: F64, zero_m: float
) -> Callable[[slice, slice], tuple[F64, F64]]:
    """Measure for `find_pairs`: ground distance; similarity falls to 0 at `zero_m` metres."""

    def measure(rows: slice, columns: slice) -> tuple[F64, F64]:
        apart = truth_xy_m[rows, None, :2] - tracks_xy_m[None, columns, :2]
        distance = np.hypot(apart[..., 0], apart[..., 1])
        return distance, np.maximum(0.0, 1.0 - distance / zero_m)

    return measure


def overlap(
    iou: Callable[[F64, F64], F64], truth_boxes: F64, track_boxes: F64
) -> Callable[[slice, slice], tuple[F64, F64]]:
    """Measure for `find_pairs`: similarity is `iou` of the boxes (any kind), distance 1 - IoU."""

    def measure(rows: slice, columns: slice) -> tuple[F64, F64]:
        similarity = iou(truth_boxes[rows], track_boxes[columns])
        return 1.0 - similarity, similarity

    return measure

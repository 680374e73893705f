"""The key frames of a scene as the page's player shows them: packed for the browser.

All lengths are whole centimetres, velocities centimetres a second, headings 1e-4 rad. Boxes are in
the world, moved so that the vehicle starts at the origin; points and cells are in the ego frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I16, I32, Floats, Texts
from mottrack.core.pose import Pose
from mottrack.core.result import SceneResult
from mottrack.core.snapshot import ObjectTable, Snapshot
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.report.payload import pack
from mottrack.report.scene_errors import SceneError

Arrays = dict[str, NDArray[Any]]
BoxTable = TypeVar("BoxTable", TruthTable, TrackTable)
MOST_FRAMES = 400
"""Longer scenes are shown from their beginning up to here."""
UNMEASURED = -(2**15)
"""In place of a velocity that nobody measured."""
FINEST = 1e-4  # radians


@dataclass(frozen=True)
class SceneStage:
    """What all runs of a scene have in common: the world that moves by."""

    result: SceneResult
    snapshots: Sequence[Snapshot]

    @property
    def frames(self) -> int:
        """How many key frames are shown."""
        return min(len(self.result.frames), MOST_FRAMES)

    @property
    def origin_m(self) -> F64:
        """(2,) where the vehicle starts."""
        origin: F64 = self.result.frames.world_T_ego[0, :2, 3]
        return origin

    def packed(self) -> str:
        """Times, poses, points and truth."""
        frames, truth = self.result.frames, self.result.truth
        yaw = [Pose.from_matrix(matrix).yaw_rad for matrix in frames.world_T_ego]
        points = _by_frame([s.xyz_m[:, :2] for s in self.snapshots], self.snapshots, self.frames)
        arrays: Arrays = {
            "pose_x": _cm(frames.world_T_ego[:, 0, 3] - self.origin_m[0]),
            "pose_y": _cm(frames.world_T_ego[:, 1, 3] - self.origin_m[1]),
            "pose_yaw": _angle(np.array(yaw)),
            "points_n": np.array([len(p) for p in points], np.uint32),
            "points_x": _short(np.concatenate([p[:, 0] for p in points])),
            "points_y": _short(np.concatenate([p[:, 1] for p in points])),
            "truth_n": np.bincount(truth.frame, minlength=len(frames))[: self.frames].astype("u4"),
            **_boxes("truth", _in_order(truth), self.origin_m),
            "truth_points": np.clip(_in_order(truth).num_points, -1, 2**15 - 1).astype(np.int16),
        }
        seconds = (frames.stamp_ns[: self.frames] - frames.stamp_ns[0]) / 1e9
        header = {
            "seconds": seconds.round(4).tolist(),
            "frames": self.frames,
            "all_frames": len(frames),
            "truth_labels": _names(_in_order(truth).label),
        }
        return pack(header, arrays)


@dataclass(frozen=True)
class RunFilm:
    """What one run made of a scene."""

    stage: SceneStage
    result: SceneResult
    snapshots: Sequence[Snapshot]
    errors: Sequence[SceneError]

    def packed(self) -> str:
        """Flow, objects, tracks and errors."""
        frames, origin_m = self.stage.frames, self.stage.origin_m
        objects = ObjectTable.stacked([s.objects for s in self.snapshots])
        tracks = _in_order(self.result.tracks)
        arrays = {
            **_flow(self.snapshots, frames),
            "objects_n": _counts([len(s.objects) for s in self.snapshots], self.snapshots, frames),
            **_boxes("objects", objects, origin_m),
            "objects_score": _score(objects.score),
            "tracks_n": np.bincount(tracks.frame, minlength=frames)[:frames].astype(np.uint32),
            **_boxes("tracks", tracks, origin_m),
            "tracks_score": _score(tracks.score),
            "tracks_observed": tracks.observed.astype(np.uint8),
            **_hulls(self.result, origin_m),
        }
        grid = next((s.grid for s in self.snapshots if len(s.cells)), None)
        header = {
            "grid": None if grid is None else [grid.x_min_m, grid.y_min_m, grid.cell_m],
            "objects_labels": _names(objects.label),
            "tracks_labels": _names(tracks.label),
            "errors": [self._error(e) for e in self.errors if e.frame < frames],
        }
        return pack(header, arrays)

    def _error(self, error: SceneError) -> list[Any]:
        x, y = (round(float(v), 2) for v in np.array(error.xy_m) - self.stage.origin_m)
        ids = [error.truth_id, error.track_id]
        return [error.frame, error.kind, error.detail, error.label, *ids, x, y]


def _flow(snapshots: Sequence[Snapshot], frames: int) -> Arrays:
    cells = _by_frame([s.cells for s in snapshots], snapshots, frames)
    velocity = _by_frame(
        [np.where(s.valid[:, None], s.velocity_mps, np.nan) for s in snapshots], snapshots, frames
    )
    flow, place = np.concatenate(velocity), np.concatenate(cells)
    return {
        "cells_n": np.array([len(c) for c in cells], np.uint32),
        "cells_row": place[:, 0].astype(np.uint16),
        "cells_column": place[:, 1].astype(np.uint16),
        "cells_vx": _short(flow[:, 0]),
        "cells_vy": _short(flow[:, 1]),
    }


def _boxes(name: str, boxes: TruthTable | TrackTable | ObjectTable, origin_m: F64) -> Arrays:
    arrays: Arrays = {
        "x": _cm(boxes.centre_m[:, 0] - origin_m[0]),
        "y": _cm(boxes.centre_m[:, 1] - origin_m[1]),
        "length": _short(boxes.size_m[:, 0]),
        "width": _short(boxes.size_m[:, 1]),
        "yaw": _angle(boxes.yaw_rad),
        "vx": _short(boxes.velocity_mps[:, 0]),
        "vy": _short(boxes.velocity_mps[:, 1]),
        "label": np.unique(boxes.label, return_inverse=True)[1].astype(np.uint16),
    }
    if not isinstance(boxes, ObjectTable):
        arrays["id"] = boxes.id.astype(np.float64)  # whole numbers up to 2^53
    return {f"{name}_{column}": values for column, values in arrays.items()}


def _hulls(result: SceneResult, origin_m: F64) -> Arrays:
    order = np.argsort(result.tracks.frame, kind="stable")
    unordered = result.hulls
    hulls = [unordered[row] for row in order]
    corners = np.concatenate([*hulls, np.zeros((0, 2))]) - origin_m
    return {
        "hulls_n": result.tracks.hull_corners[order].astype(np.uint16),
        "hulls_x": _cm(corners[:, 0]),
        "hulls_y": _cm(corners[:, 1]),
    }


def _by_frame(
    parts: Sequence[NDArray[Any]], snapshots: Sequence[Snapshot], frames: int
) -> list[NDArray[Any]]:
    """One (N, 2) array a key frame; empty where no snapshot was kept."""
    kept = {s.frame: part for s, part in zip(snapshots, parts, strict=True)}
    return [kept.get(frame, np.zeros((0, 2))) for frame in range(frames)]


def _counts(
    counts: Sequence[int], snapshots: Sequence[Snapshot], frames: int
) -> NDArray[np.uint32]:
    kept = {s.frame: count for s, count in zip(snapshots, counts, strict=True)}
    return np.array([kept.get(frame, 0) for frame in range(frames)], np.uint32)


def _in_order(table: BoxTable) -> BoxTable:
    return table.select(np.argsort(table.frame, kind="stable"))


def _names(labels: Texts) -> list[str]:
    return [str(name) for name in np.unique(labels)]


def _cm(metres: Floats) -> I32:
    steps: I32 = np.rint(100 * metres).astype(np.int32)
    return steps


def _short(values: Floats) -> I16:
    """Hundredths in 16 bits, cut off at 327; NaN is UNMEASURED."""
    steps = np.clip(np.rint(100 * np.nan_to_num(values)), UNMEASURED + 1, -UNMEASURED - 1)
    return np.where(np.isnan(values), UNMEASURED, steps).astype(np.int16)


def _angle(yaw_rad: F64) -> I32:
    return np.rint(yaw_rad / FINEST).astype(np.int32)


def _score(score: F64) -> I16:
    return _short(score)

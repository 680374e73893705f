"""Key frames of a scene packed for the page's player.

Lengths are whole centimetres, velocities whole centimetres per second, headings 1e-4 rad. Boxes are
in the world frame, shifted so that the vehicle starts at the origin; points and cells are in the
ego frame of their key frame. A packed scene is, compressed by gzip and written in base64:

    4 bytes   length of the header, little endian
    header    JSON, padded with spaces to a multiple of 8 bytes:
              {"arrays": {name: [type, first byte, count]}, ...further values}
    arrays    little endian, each starting at a multiple of 8 bytes

``templates/js/recording.js`` reads it.
"""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from mottrack.core.arrays import F64, I16, I32, Floats, Texts
from mottrack.core.pose import Pose
from mottrack.core.result import SceneResult
from mottrack.core.snapshot import ObjectTable, Snapshot
from mottrack.core.sweep import SECOND_NS
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.report.scene_errors import SceneError

Arrays = dict[str, NDArray[Any]]
BoxTable = TypeVar("BoxTable", TruthTable, TrackTable)
MAX_FRAMES = 400
"""Longer scenes are shown up to here: 40 s at 10 Hz, a few megabytes of the page."""
UNMEASURED = -(2**15)
"""In place of a velocity that was not measured; recording.js has the same."""
YAW_STEP_RAD = 1e-4  # half a centimetre at 50 m: the resolution of the lengths
TYPES = {"|i1", "|u1", "<i2", "<u2", "<i4", "<u4", "<f8"}
"""Types for which a browser has typed arrays."""
ALIGNMENT = 8
"""Bytes: a typed array of the widest type must start at a multiple of its size."""


def pack(header: dict[str, Any], arrays: Arrays) -> str:
    """Pack a JSON header and arrays as base64 text; the same content gives the same text.

    Raises:
        TypeError: an array has a type for which browsers have no typed array.
    """
    body = bytearray()
    places: dict[str, list[Any]] = {}
    for name, array in arrays.items():
        kind = array.dtype.newbyteorder("<").str
        if kind not in TYPES:
            raise TypeError(f"array '{name}' is {kind}, expected one of {sorted(TYPES)}")
        places[name] = [kind[1:], len(body), array.size]
        body += _padded(array.astype(kind).tobytes(), b"\0")
    text = json.dumps({**header, "arrays": places}, separators=(",", ":"), allow_nan=False)
    length = len(text.encode()).to_bytes(4, "little")
    whole = _padded(length + text.encode(), b" ") + bytes(body)
    return base64.b64encode(gzip.compress(whole, mtime=0)).decode()


def _padded(data: bytes, filler: bytes) -> bytes:
    return data + filler * (-len(data) % ALIGNMENT)


@dataclass(frozen=True)
class SharedData:
    """Data that all runs share of a scene: times, poses, points and truth."""

    result: SceneResult
    snapshots: Sequence[Snapshot]

    @property
    def frames(self) -> int:
        """Number of key frames that are shown."""
        return min(len(self.result.frames), MAX_FRAMES)

    @property
    def origin_m(self) -> F64:
        """(2,) start of the vehicle, world frame."""
        return self.result.frames.world_T_ego[0, :2, 3]

    def packed(self) -> str:
        """Pack it for the page."""
        frames, truth = self.result.frames, _by_time(self.result.truth)
        yaw_rad = np.array([Pose.from_matrix(matrix).yaw_rad for matrix in frames.world_T_ego])
        points = _by_frame([s.xyz_m[:, :2] for s in self.snapshots], self.snapshots, self.frames)
        arrays: Arrays = {
            "pose_x": _cm(frames.world_T_ego[:, 0, 3] - self.origin_m[0]),
            "pose_y": _cm(frames.world_T_ego[:, 1, 3] - self.origin_m[1]),
            "pose_yaw": _angle(yaw_rad),
            "points_n": _lengths(points),
            "points_x": _cm16(np.concatenate([p[:, 0] for p in points])),
            "points_y": _cm16(np.concatenate([p[:, 1] for p in points])),
            "truth_n": _rows_per_frame(truth, self.frames),
            **_boxes("truth", truth, self.origin_m),
            "truth_points": np.clip(truth.num_points, -1, 2**15 - 1).astype(np.int16),
        }
        seconds = (frames.stamp_ns[: self.frames] - frames.stamp_ns[0]) / SECOND_NS
        header = {
            "seconds": seconds.round(4).tolist(),
            "frames": self.frames,
            "all_frames": len(frames),
            "truth_labels": _names(truth.label),
        }
        return pack(header, arrays)


@dataclass(frozen=True)
class RunData:
    """Flow, objects, tracks and errors of one run on a scene."""

    shared: SharedData
    result: SceneResult
    snapshots: Sequence[Snapshot]
    errors: Sequence[SceneError]

    def packed(self) -> str:
        """Pack it for the page."""
        frames, origin_m = self.shared.frames, self.shared.origin_m
        objects = ObjectTable.stacked([s.objects for s in self.snapshots])
        centres = [s.objects.centre_m[:, :2] for s in self.snapshots]
        tracks = _by_time(self.result.tracks)
        arrays = {
            **_flow(self.snapshots, frames),
            "objects_n": _lengths(_by_frame(centres, self.snapshots, frames)),
            **_boxes("objects", objects, origin_m),
            "objects_score": _cm16(objects.score),
            "tracks_n": _rows_per_frame(tracks, frames),
            **_boxes("tracks", tracks, origin_m),
            "tracks_score": _cm16(tracks.score),
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
        x, y = (round(float(v), 2) for v in np.array(error.xy_m) - self.shared.origin_m)
        ids = [error.truth_id, error.track_id]
        return [error.frame, error.kind, error.detail, error.label, *ids, x, y]


def _flow(snapshots: Sequence[Snapshot], frames: int) -> Arrays:
    cells = _by_frame([s.cells for s in snapshots], snapshots, frames)
    velocity = _by_frame(
        [np.where(s.valid[:, None], s.velocity_mps, np.nan) for s in snapshots], snapshots, frames
    )
    flow, place = np.concatenate(velocity), np.concatenate(cells)
    return {
        "cells_n": _lengths(cells),
        "cells_row": place[:, 0].astype(np.uint16),
        "cells_column": place[:, 1].astype(np.uint16),
        "cells_vx": _cm16(flow[:, 0]),
        "cells_vy": _cm16(flow[:, 1]),
    }


def _boxes(name: str, boxes: TruthTable | TrackTable | ObjectTable, origin_m: F64) -> Arrays:
    arrays: Arrays = {
        "x": _cm(boxes.centre_m[:, 0] - origin_m[0]),
        "y": _cm(boxes.centre_m[:, 1] - origin_m[1]),
        "length": _cm16(boxes.size_m[:, 0]),
        "width": _cm16(boxes.size_m[:, 1]),
        "yaw": _angle(boxes.yaw_rad),
        "vx": _cm16(boxes.velocity_mps[:, 0]),
        "vy": _cm16(boxes.velocity_mps[:, 1]),
        "label": np.unique(boxes.label, return_inverse=True)[1].astype(np.uint16),
    }
    if not isinstance(boxes, ObjectTable):
        arrays["id"] = boxes.id.astype(np.float64)  # exact for identities up to 2^53
    return {f"{name}_{column}": values for column, values in arrays.items()}


def _hulls(result: SceneResult, origin_m: F64) -> Arrays:
    order, unordered = np.argsort(result.tracks.frame, kind="stable"), result.hulls
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
    """Return one (N, 2) array per key frame, empty where no snapshot was kept."""
    kept = {s.frame: part for s, part in zip(snapshots, parts, strict=True)}
    return [kept.get(frame, np.zeros((0, 2))) for frame in range(frames)]


def _lengths(parts: Sequence[NDArray[Any]]) -> NDArray[np.uint32]:
    return np.array([len(part) for part in parts], np.uint32)


def _rows_per_frame(table: TruthTable | TrackTable, frames: int) -> NDArray[np.uint32]:
    return np.bincount(table.frame, minlength=frames)[:frames].astype(np.uint32)


def _by_time(table: BoxTable) -> BoxTable:
    return table.select(np.argsort(table.frame, kind="stable"))


def _names(labels: Texts) -> list[str]:
    return [str(name) for name in np.unique(labels)]


def _cm(metres: Floats) -> I32:
    return np.rint(100 * metres).astype(np.int32)


def _cm16(values: Floats) -> I16:
    """Convert to hundredths in 16 bits, clipped at 327; NaN becomes UNMEASURED."""
    steps = np.clip(np.rint(100 * np.nan_to_num(values)), UNMEASURED + 1, -UNMEASURED - 1)
    return np.where(np.isnan(values), UNMEASURED, steps).astype(np.int16)


def _angle(yaw_rad: F64) -> I32:
    return np.rint(yaw_rad / YAW_STEP_RAD).astype(np.int32)

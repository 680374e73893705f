"""A scene as a rerun recording: points, flow, boxes, tracks with velocities, truth, over time.

Coordinates are those of the world, moved so that the vehicle starts at the origin: the viewer
computes in 32 bits, in which map coordinates have steps of half a metre.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.core.errors import ConfigError, InputError
from mottrack.core.flow_colour import bold_flow_to_rgb
from mottrack.core.motion import FULL_COLOUR_MPS, STILL_MPS
from mottrack.core.pose import Pose
from mottrack.core.result import SceneResult
from mottrack.core.snapshot import ObjectTable, Snapshot
from mottrack.core.sweep import SECOND_NS
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.viz.bev import hulls_of

APPLICATION = "mottrack"
TRUTH_COLOUR, OBJECT_COLOUR, POINT_COLOUR = (46, 158, 91), (37, 99, 235), (156, 163, 175)
TRACK_COLOURS = np.array(
    [(194, 65, 12), (147, 51, 234), (202, 138, 4), (8, 145, 178), (219, 39, 119), (101, 163, 13)]
)
"""By track number: a track keeps its colour, and consecutive numbers differ."""
POINT_RADIUS_M = 0.05
FLOW_HEIGHT_M = 0.1  # above the ground, which would hide part of it
STILL_GREY = 75
Boxes = TruthTable | TrackTable | ObjectTable


@dataclass(frozen=True)
class Recording:
    """One scene in rerun.

    Raises:
        ConfigError: rerun is not installed.
    """

    rerun: Any
    stream: Any

    @classmethod
    def of(cls, scene: str) -> Recording:
        """Create an empty recording with the scene's name."""
        try:
            rerun = importlib.import_module("rerun")
        except ImportError as error:
            raise ConfigError(
                "the viewer needs rerun: pip install 'mottrack[viz]'; `mottrack animate` writes "
                "a GIF without it"
            ) from error
        return cls(rerun, rerun.RecordingStream(APPLICATION, recording_id=scene))

    def show(self) -> None:
        """Open a window, or adds the scene to the one that is open."""
        self.rerun.spawn(recording=self.stream)

    def write_to(self, path: Path) -> None:
        """Send all that follows to a file.

        Raises:
            InputError: the path does not end in .rrd.
        """
        if path.suffix != ".rrd":
            raise InputError("ending of the recording", path.name, ".rrd")
        path.parent.mkdir(parents=True, exist_ok=True)
        self.stream.save(path)

    def log(self, result: SceneResult, snapshots: Sequence[Snapshot]) -> None:
        """Log every key frame of a scene and close the recording when all is written."""
        kept = {snapshot.frame: snapshot for snapshot in snapshots}
        frames = result.frames
        self.stream.log("world", self.rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for frame in range(len(frames)):
            self.stream.set_time("frame", sequence=frame)
            self.stream.set_time(
                "time", duration=(frames.stamp_ns[frame] - frames.stamp_ns[0]) / SECOND_NS
            )
            origin_m = frames.world_T_ego[0, :3, 3]
            self._log_vehicle(Pose.from_matrix(frames.world_T_ego[frame]), origin_m)
            if frame in kept:
                self._log_snapshot(kept[frame], origin_m)
            self._log_boxes(
                "world/truth", result.truth.select(result.truth.frame == frame), origin_m
            )
            self._log_tracks(result, np.flatnonzero(result.tracks.frame == frame), origin_m)
        self.stream.flush()
        self.stream.disconnect()

    def _log_vehicle(self, world_T_ego: Pose, origin_m: F64) -> None:
        moved = self.rerun.Transform3D(
            translation=world_T_ego.translation_m - origin_m, mat3x3=world_T_ego.rotation
        )
        self.stream.log("world/ego", moved)

    def _log_snapshot(self, snapshot: Snapshot, origin_m: F64) -> None:
        """Log points and flow in the vehicle's frame, the tracker's input in the world's."""
        points = self.rerun.Points3D(snapshot.xyz_m, colors=POINT_COLOUR, radii=POINT_RADIUS_M)
        self.stream.log("world/ego/points", points)
        moving = snapshot.valid & (np.hypot(*snapshot.velocity_mps.T) > STILL_MPS)
        colours = np.full((len(moving), 3), STILL_GREY, np.uint8)
        rgb = bold_flow_to_rgb(snapshot.velocity_mps[moving], FULL_COLOUR_MPS)
        colours[moving] = np.round(255 * rgb)
        centres_m = np.pad(snapshot.xy_m, ((0, 0), (0, 1)), constant_values=FLOW_HEIGHT_M)
        half_m = np.array([0.5, 0.5, 0.0]) * snapshot.grid.cell_m
        half_sizes = np.broadcast_to(half_m, centres_m.shape)
        cells = self.rerun.Boxes3D(
            centers=centres_m, half_sizes=half_sizes, colors=colours, fill_mode="solid"
        )
        self.stream.log("world/ego/flow", cells)
        self._log_boxes("world/objects", snapshot.objects, origin_m)

    def _log_tracks(self, result: SceneResult, rows: I64, origin_m: F64) -> None:
        tracks = result.tracks.select(rows)
        self._log_boxes("world/tracks", tracks, origin_m)
        moving = tracks.select(np.asarray(np.isfinite(tracks.velocity_mps).all(axis=1)))
        arrows = self.rerun.Arrows3D(
            origins=moving.centre_m - origin_m,
            vectors=np.pad(moving.velocity_mps, ((0, 0), (0, 1))),
            colors=_colours(moving),
        )
        self.stream.log("world/tracks/velocity", arrows)
        closed = [np.concatenate([h, h[:1]]) - origin_m[:2] for h in hulls_of(result, rows)]
        colours = _colours(tracks.select(tracks.hull_corners > 0))
        strips = self.rerun.LineStrips3D(
            [np.pad(hull, ((0, 0), (0, 1))) for hull in closed], colors=colours
        )
        self.stream.log("world/tracks/hulls", strips)

    def _log_boxes(self, path: str, boxes: Boxes, origin_m: F64) -> None:
        half_yaw = boxes.yaw_rad / 2
        zero = np.zeros(len(boxes))
        self.stream.log(
            path,
            self.rerun.Boxes3D(
                centers=boxes.centre_m - origin_m,
                half_sizes=boxes.size_m / 2,
                quaternions=np.column_stack([zero, zero, np.sin(half_yaw), np.cos(half_yaw)]),
                colors=_colours(boxes),
                labels=_labels(boxes),
            ),
        )


def _colours(boxes: Boxes) -> I64:
    """Return (N, 3) red, green, blue."""
    if isinstance(boxes, TrackTable):
        return np.take(TRACK_COLOURS, boxes.id % len(TRACK_COLOURS), axis=0)
    colour = TRUTH_COLOUR if isinstance(boxes, TruthTable) else OBJECT_COLOUR
    return np.tile(np.array(colour), (len(boxes), 1))


def _labels(boxes: Boxes) -> list[str]:
    if isinstance(boxes, ObjectTable):
        scores = zip(boxes.label, boxes.score, strict=True)
        return [f"{label} {score:.2f}" for label, score in scores]
    return [f"{label} {number}" for label, number in zip(boxes.label, boxes.id, strict=True)]

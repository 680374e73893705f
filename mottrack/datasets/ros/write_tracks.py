"""Tracks of a stored run as a log that rviz and Foxglove show beside the recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mottrack.core import Pose, SceneResult
from mottrack.core.snapshot import Snapshot
from mottrack.core.tables import TrackTable
from mottrack.datasets.ros.markers import flow_markers, track_markers
from mottrack.datasets.ros.mcap_writer import McapWriter, new_mcap
from mottrack.datasets.ros.new_messages import (
    box_of,
    detection,
    header,
    new,
    point_cloud,
    transform,
    xyz_columns,
)

MARKERS, BOXES, FLOW, POINTS = "/tracks/markers", "/tracks/boxes", "/tracks/flow", "/tracks/points"
TF = "/tf"


@dataclass(frozen=True)
class FrameNames:
    """Names of tf's frames, as the recording that the tracks are shown beside has them."""

    world: str = "map"
    ego: str = "base_link"


def write_tracks_mcap(
    path: Path,
    result: SceneResult,
    snapshots: Sequence[Snapshot] = (),
    names: FrameNames = FrameNames(),
) -> int:
    """Write the tracks of one scene as a ROS 2 log; return the number of track rows.

    Every message has the stamp of its key frame. Topics: `/tf` (world to vehicle),
    `/tracks/markers` (box, velocity and identity of each track), `/tracks/boxes`
    (vision_msgs/Detection3DArray, the identity in `id`) and, from snapshots where the run kept
    them, `/tracks/flow` (lines) and `/tracks/points`.

    Args:
        path: the file, `<scene>.mcap`.
        result: stored result of the scene.
        snapshots: points and flow of its key frames.
        names: of the frames.

    Raises:
        ImportError: the extra `ros` is not installed.
        OSError: the file cannot be written.
    """
    kept = {snapshot.frame: snapshot for snapshot in snapshots}
    with new_mcap(path) as log:
        for frame, stamp_ns in enumerate(result.frames.stamp_ns.tolist()):
            world_T_ego = Pose.from_matrix(result.frames.world_T_ego[frame])
            log.add(TF, stamp_ns, transform(stamp_ns, names.world, names.ego, world_T_ego))
            tracks = result.tracks.select(result.tracks.frame == frame)
            log.add(MARKERS, stamp_ns, track_markers(stamp_ns, names.world, tracks))
            stamped = header(stamp_ns, names.world)
            boxes = [_detection(stamped, tracks, row) for row in range(len(tracks))]
            log.add(BOXES, stamp_ns, new("vision_msgs/Detection3DArray", stamped, boxes))
            if frame in kept:
                _add_snapshot(log, stamp_ns, names.ego, kept[frame])
    return len(result.tracks)


def _detection(stamped: object, tracks: TrackTable, row: int) -> object:
    box = box_of(tracks.centre_m[row], tracks.size_m[row], tracks.yaw_rad[row])
    label, score = str(tracks.label[row]), float(tracks.score[row])
    return detection(stamped, label, score, box, str(tracks.id[row]))


def _add_snapshot(log: McapWriter, stamp_ns: int, ego: str, snapshot: Snapshot) -> None:
    measured = snapshot.valid
    cells = flow_markers(stamp_ns, ego, snapshot.xy_m[measured], snapshot.velocity_mps[measured])
    log.add(FLOW, stamp_ns, cells)
    if len(snapshot.xyz_m):
        log.add(POINTS, stamp_ns, point_cloud(stamp_ns, ego, xyz_columns(snapshot.xyz_m)))

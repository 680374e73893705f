"""Tracks in KITTI's result format: written of any run, read of any tracker."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mottrack.core import DataError, Pose, SceneResult
from mottrack.core.arrays import I64
from mottrack.core.pose import wrap_angle
from mottrack.core.tables import TrackTable
from mottrack.datasets.imported import ImportedTracks
from mottrack.datasets.kitti.boxes import (
    CameraBoxes,
    EgoBoxes,
    camera_to_ego,
    ego_to_camera,
    image_boxes,
    in_image,
)
from mottrack.datasets.kitti.camera import Camera
from mottrack.datasets.kitti.labels import camera_boxes, read_label_file
from mottrack.datasets.kitti.write import KIND_OF
from mottrack.datasets.scene_boxes import to_world, unknown_velocities
from mottrack.datasets.scene_frames import MAX_NUMBER_DIGITS, SceneFrames
from mottrack.formats.kitti_rows import KittiResults, write_kitti_results


def frame_numbers(result: SceneResult) -> I64:
    """Return KITTI's number (T,) of each frame: its token on KITTI, elsewhere its place."""
    tokens = result.frames.token.tolist()
    if all(token.isdecimal() and len(token) <= MAX_NUMBER_DIGITS for token in tokens):
        return np.array(tokens, np.int64)
    return np.arange(len(tokens))


def write_tracks(path: Path, result: SceneResult, camera: Camera) -> int:
    """Write the tracks of a scene of which the camera sees something; return how many boxes.

    KITTI's files have no place for others: what is outside the image is not labelled.
    """
    tracks = seen_tracks(result, camera)
    boxes = in_camera(tracks, result, camera)
    rows = KittiResults(
        frame=frame_numbers(result)[tracks.frame],
        track=tracks.id,
        kind=np.array([KIND_OF.get(str(label), "Misc") for label in tracks.label], np.str_),
        alpha_rad=wrap_angle(boxes.ry_rad - np.arctan2(boxes.bottom_m[:, 0], boxes.bottom_m[:, 2])),
        image_box=image_boxes(boxes, camera.projection, camera.size),
        size_hwl_m=boxes.size_hwl_m,
        bottom_m=boxes.bottom_m,
        ry_rad=boxes.ry_rad,
        score=tracks.score,
    )
    write_kitti_results(path, rows)
    return len(tracks)


def seen_tracks(result: SceneResult, camera: Camera) -> TrackTable:
    """Return the tracks of which some part is in the image."""
    tracks = result.tracks
    seen = in_image(in_camera(tracks, result, camera), camera.projection)
    return tracks.select(np.flatnonzero(seen))


def in_camera(tracks: TrackTable, result: SceneResult, camera: Camera) -> CameraBoxes:
    """Return the boxes of tracks of a result in the camera's frame."""
    world_T_ego = result.frames.world_T_ego[tracks.frame]
    from_ego = tracks.centre_m - world_T_ego[:, :3, 3]
    centre_m = np.einsum("nji,nj->ni", world_T_ego[:, :3, :3], from_ego)
    ego_yaw = np.array([Pose.from_matrix(m).yaw_rad for m in result.frames.world_T_ego])
    yaw_rad = wrap_angle(tracks.yaw_rad - ego_yaw[tracks.frame])
    return ego_to_camera(EgoBoxes(centre_m, tracks.size_m, yaw_rad), camera.ego_T_camera)


def read_tracks(
    path: Path, frames: SceneFrames, camera: Camera, class_map: Mapping[str, str]
) -> ImportedTracks:
    """Read one sequence's tracks; types that have no label are left out.

    Args:
        path: the result file.
        frames: of the sequence, by number.
        camera: of the sequence.
        class_map: KITTI type to label.

    Raises:
        DataError: a broken line, a track twice in a frame, or a frame that is not the sequence's.
    """
    table = read_label_file(path)
    label = np.array([class_map.get(str(kind), "") for kind in table["type"]], dtype=np.str_)
    kept = np.flatnonzero(label != "")
    table, label = table.select(kept), label[kept]
    place = frames.places([f"{number:06d}" for number in table["frame"]])
    if (place < 0).any():
        row = int(np.argmax(place < 0))
        expected = f"one of the {len(frames.stamp_ns)} frames of {frames.scene}"
        raise DataError(path, f"line {table.row[row]}, frame", int(table["frame"][row]), expected)
    ego = camera_to_ego(camera_boxes(table), camera.ego_T_camera)
    centre_m, yaw_rad = to_world(ego.centre_m, ego.yaw_rad, place, frames.world_T_ego)
    return ImportedTracks(
        frame=place,
        label=label,
        score=table["score"],
        centre_m=centre_m,
        size_m=ego.size_m,
        yaw_rad=yaw_rad,
        velocity_mps=unknown_velocities(len(table)),
        track=table["track"].astype(np.str_),
        observed=np.ones(len(table), np.bool_),
    )

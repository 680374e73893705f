"""Tracks out of tables: csv, Parquet and feather files with a row for each box."""

from __future__ import annotations

from typing import Literal

import numpy as np

from mottrack.core.errors import DataError
from mottrack.core.pose import wrap_angle
from mottrack.datasets.imported import ImportedTracks
from mottrack.datasets.scene_boxes import to_world
from mottrack.datasets.scene_frames import SceneFrames
from mottrack.formats.box_table import PLACE, SIZE, VELOCITY, BoxRows

TrackFrame = Literal["world", "ego"]


def table_tracks(
    table_rows: BoxRows, frames: SceneFrames, boxes_in: TrackFrame
) -> ImportedTracks | None:
    """Return the tracks of one scene; None where the table has none of it.

    Velocities are over the ground, in the axes of the frame that the boxes are in.

    Args:
        table_rows: the whole table, read with `tracks=True`.
        frames: of the scene.
        boxes_in: frame of the boxes.

    Raises:
        DataError: a frame that the scene lacks, or a track twice in a frame.
    """
    rows = table_rows.of_scene(frames.scene)
    if rows.scenes is None:
        rows = _of_frames(rows, frames)
    table = rows.table
    if not len(table):
        return None
    place = frames.places_of_keys(rows.keys, table.path)
    numbered = np.unique(table["id"], return_inverse=True)[1]
    table.refuse_repeated("id", np.column_stack([place, numbered]), "each track once a frame")
    centre_m, yaw_rad, velocity = table.stacked(PLACE), table["yaw"], table.stacked(VELOCITY)
    if boxes_in == "ego":
        turn = np.array([pose.yaw_rad for pose in frames.world_T_ego])[place]
        cos, sin = np.cos(turn), np.sin(turn)
        vx, vy = velocity.T
        velocity = np.column_stack([cos * vx - sin * vy, sin * vx + cos * vy])
        centre_m, yaw_rad = to_world(centre_m, yaw_rad, place, frames.world_T_ego)
    known = np.asarray(np.isfinite(velocity).all(axis=1))
    return ImportedTracks(
        frame=place,
        label=table["label"],
        score=table["score"],
        centre_m=centre_m,
        size_m=table.stacked(SIZE),
        yaw_rad=wrap_angle(yaw_rad),
        velocity_mps=np.where(known[:, None], velocity, np.nan),
        track=table["id"],
        observed=table["observed"] == 1,
    )


def _of_frames(rows: BoxRows, frames: SceneFrames) -> BoxRows:
    """Return the rows of a file without scenes whose stamp or token is one of this scene."""
    if frames.counted:
        expected = f"a column scene: frame {frames.names[0][0]} is in every scene"
        raise DataError(rows.table.path, "column", "without scene", expected)
    here = frames.rows_of_scene(rows.keys, rows.table.path)
    return BoxRows(rows.table.select(here), rows.keys[here], None)

"""Scenes with truth and tracks that tests can work out by hand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mottrack.core import SceneResult
from mottrack.core.scene_objects import SceneObjects
from mottrack.core.tables import ALL_AROUND_RAD, FrameTable, TrackTable, TruthTable
from mottrack.eval.scores import ScoreConfig, ScoreFilter
from mottrack.eval.tracked_scenes import TrackedScenes


class Box(NamedTuple):
    frame: int
    id: int
    x: float
    y: float
    label: str = "car"
    speed: float = 0.0
    score: float = 0.9


def columns(boxes: Sequence[Box]) -> dict:
    count = len(boxes)
    return {
        "label": np.array([b.label for b in boxes], np.str_),
        "centre_m": np.array([(b.x, b.y, 0.0) for b in boxes]).reshape(-1, 3),
        "size_m": np.tile([4.0, 2.0, 1.5], (count, 1)),
        "yaw_rad": np.zeros(count),
        "velocity_mps": np.array([(b.speed, 0.0) for b in boxes]).reshape(-1, 2),
        "frame": np.array([b.frame for b in boxes], np.int64),
    }


def scenes(
    truth: Sequence[Box],
    tracks: Sequence[Box],
    detections: Sequence[Box] | None = None,
    labels: Sequence[str] = ("car",),
    frames: int = 8,
) -> TrackedScenes:
    """One scene, the vehicle at rest in the origin, half a second a frame."""
    count = len(tracks)
    table = FrameTable(
        stamp_ns=np.arange(frames) * 500_000_000,
        token=np.array([str(k) for k in range(frames)]),
        world_T_ego=np.tile(np.eye(4), (frames, 1, 1)),
        labelled_azimuth_rad=np.tile(ALL_AROUND_RAD, (frames, 1)),
        annotated=np.ones(frames, np.bool_),
    )
    true = TruthTable(
        **columns(truth),
        id=np.array([b.id for b in truth], np.int64),
        num_points=np.full(len(truth), 9),
        interpolated=np.zeros(len(truth), np.bool_),
    )
    said = TrackTable(
        **columns(tracks),
        id=np.array([b.id for b in tracks], np.int64),
        velocity_covariance_m2ps2=np.tile(np.eye(2), (count, 1, 1)),
        score=np.array([b.score for b in tracks], np.float64),
        observed=np.ones(count, np.bool_),
        hull_corners=np.zeros(count, np.int64),
    )
    objects = None
    if detections is not None:
        score = np.array([b.score for b in detections])
        objects = SceneObjects(**columns(detections), score=score)
    return TrackedScenes(
        (SceneResult("one", table, true, said),),
        ScoreConfig(),
        (objects,),
        counted=tuple(ScoreFilter(label) for label in labels),
    )

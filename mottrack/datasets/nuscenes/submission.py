"""Tracking results in the official submission format."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import orjson

from mottrack.core import Boxes, DataError, InputError, SceneResult, TrackTable
from mottrack.core.arrays import I64
from mottrack.core.storage import write_bytes
from mottrack.formats.nuscenes_classes import CLASSES
from mottrack.formats.rigid import yaw_quaternions
from mottrack.formats.table_stream import Row

MAX_BOXES = 500
"""A submission may hold so many boxes a sample; those of the highest score are kept."""
LIDAR_ONLY = {
    "use_camera": False,
    "use_lidar": True,
    "use_radar": False,
    "use_map": False,
    "use_external": False,
}


class Samples(NamedTuple):
    """The sample tokens that a submission must have, and the split that they are."""

    tokens: Collection[str]
    split: str


def write_submission(
    path: Path,
    results: Iterable[SceneResult],
    *,
    expected: Samples | None = None,
    meta: dict[str, bool] | None = None,
) -> int:
    """Write a tracking submission; return the number of its boxes.

    Every frame of the results becomes a sample, without boxes too. Identities are made unique by
    the scene's name.

    Args:
        path: the JSON file.
        results: one for each scene of the split.
        expected: all samples that the split has, to be sure that none is missing.
        meta: which inputs were used; LiDAR only by default.

    Raises:
        InputError: a frame has no token, a token comes twice, or a track has another class.
        DataError: a sample of the split is in no result.
    """
    samples: dict[str, list[Row]] = {}
    for result in results:
        _add_scene(samples, result)
    missing = sorted(set(expected.tokens) - samples.keys()) if expected else []
    if expected and missing:
        words = (
            f"every sample of split {expected.split}: {len(missing)} of {len(expected.tokens)} are "
            "missing (was the run over another --split?)"
        )
        raise DataError(path, "sample", f"{missing[0]} not tracked", words)
    write_bytes(
        path, orjson.dumps({"meta": LIDAR_ONLY if meta is None else meta, "results": samples})
    )
    return sum(len(boxes) for boxes in samples.values())


def _add_scene(samples: dict[str, list[Row]], result: SceneResult) -> None:
    tracks = result.tracks
    unknown = sorted(set(tracks.label.tolist()) - set(CLASSES))
    if unknown:
        raise InputError(f"class of a track in {result.name}", unknown[0], ", ".join(CLASSES))
    geometry = box_geometry(tracks)
    velocity_mps = np.nan_to_num(tracks.velocity_mps)  # the format has no word for "not known"
    for frame, token in enumerate(result.frames.token.tolist()):
        if not token or token in samples:
            raise InputError(
                f"token of frame {frame} of {result.name}", repr(token), "one of its own"
            )
        samples[token] = [
            {
                "sample_token": token,
                **geometry[row],
                "velocity": velocity_mps[row].tolist(),
                "tracking_id": f"{result.name}_{tracks.id[row]}",
                "tracking_name": str(tracks.label[row]),
                "tracking_score": float(tracks.score[row]),
            }
            for row in _best_scored(tracks, np.flatnonzero(tracks.frame == frame)).tolist()
        ]


def _best_scored(tracks: TrackTable, rows: I64) -> I64:
    """Return the rows, at most `MAX_BOXES` of them, in the order of the table."""
    if len(rows) <= MAX_BOXES:
        return rows
    order = np.argsort(-tracks.score[rows], kind="stable")[:MAX_BOXES]
    return rows[np.sort(order)]


def box_geometry(boxes: Boxes | TrackTable) -> list[Row]:
    """Return translation, size (w, l, h) and rotation (w, x, y, z) of N boxes in the world."""
    rotation = yaw_quaternions(boxes.yaw_rad)
    return [
        {
            "translation": boxes.centre_m[i].tolist(),
            "size": boxes.size_m[i, [1, 0, 2]].tolist(),
            "rotation": rotation[i].tolist(),
        }
        for i in range(len(boxes.yaw_rad))
    ]

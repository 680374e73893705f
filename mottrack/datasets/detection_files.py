"""Detections of any data set out of tables (csv, Parquet, feather) and of detectors' exports."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.core.arrays import F64, I64, Texts
from mottrack.core.errors import DataError
from mottrack.core.pose import rotation_2d, wrap_angle
from mottrack.datasets.scene_boxes import DetectionTable, to_world
from mottrack.datasets.scene_frames import SceneFrames
from mottrack.formats.box_table import PLACE, SIZE, SUFFIXES, VELOCITY, BoxRows, read_box_rows
from mottrack.formats.detector_exports import DetectorBoxes, read_export
from mottrack.formats.faults import MissingError

SCENE = "{scene}"
"""Stands for the name of the scene in the path of detections."""
FILES_KEPT = 2
"""Files of all scenes are read once: of one data set there is one, of two compared ones two."""
BoxFrame = Literal["lidar", "ego", "world"]


class DetectorConfig(StrictModel):
    """What a file of detections does not say itself."""

    frame: BoxFrame | None = Field(
        None, description="frame of the boxes; null: lidar in detectors' exports, ego in tables"
    )
    classes: tuple[str, ...] = Field(
        (), description="names of labels that are numbers, in the detector's order"
    )


def is_general(detections: Path | str | None) -> bool:
    """Return whether a file of detections is a table or an export, which any data set takes."""
    if detections is None:
        return False
    text = str(detections)
    return SCENE in text or Path(text).suffix in (".csv", ".parquet", ".npz", ".json")


def general_detections(
    pattern: Path, frames: SceneFrames, config: DetectorConfig
) -> DetectionTable | None:
    """Return the detections of a scene in the world; `frame` is the place in `frames`.

    Args:
        pattern: the file, or the folder of MMDetection3D's files; ``{scene}`` is the scene's name.
        frames: the frames of the scene.
        config: the frame of the boxes, and the names of numbered labels.

    Returns:
        None where the file holds no frame of this scene: no detector ran on it.

    Raises:
        DataError: missing or damaged file, a frame that the scene lacks, or, of a detector's
            export, a frame of the scene that is missing.
    """
    path = Path(str(pattern).replace(SCENE, frames.scene))
    own = SCENE in str(pattern)
    if path.suffix in SUFFIXES:
        rows = _rows(path, _state(path)).of_scene(frames.scene)
        found = _of_rows(rows, frames, own=own)
    else:
        found = _of_export(_export(path, config.classes, _state(path)), frames, own=own)
    if found is None:
        return None
    return _in_world(found, frames, config.frame or found.frame_kind)


class _Found(NamedTuple):
    """Boxes with the place of their frame, not yet in the world."""

    frame_kind: BoxFrame
    place: I64
    label: Texts
    score: F64
    centre_m: F64
    size_m: F64
    yaw_rad: F64
    velocity_mps: F64


def relabelled(table: DetectionTable, labels: Mapping[str, str], path: Path) -> DetectionTable:
    """Return the rows of known classes, under the data set's names; case does not matter.

    Args:
        table: detections with the detector's names.
        labels: name to label; labels stand for themselves.
        path: the file, for an error.

    Raises:
        DataError: no row is of a known class.
    """
    known = {name.lower(): label for name, label in labels.items()}
    known |= {label.lower(): label for label in labels.values()}
    names, inverse = np.unique(table.label, return_inverse=True)
    mapped = np.array([known.get(str(name).lower(), "") for name in names], np.str_)
    if len(names) and not (mapped != "").any():
        raise DataError(path, "label", str(names[0]), f"one of {', '.join(sorted(known))}")
    label = mapped[inverse] if len(names) else table.label
    columns = {name: getattr(table, name) for name in table.COLUMNS} | {"label": label}
    return DetectionTable(**columns).select(label != "")


def _state(path: Path) -> tuple[int, int]:
    """Return size and time of a file: another state is read anew."""
    if not path.exists():
        raise MissingError(path, "detections", "missing", "a file of detections")
    stat = path.stat()
    return stat.st_size, stat.st_mtime_ns


@lru_cache(maxsize=FILES_KEPT)
def _rows(path: Path, _state: tuple[int, int]) -> BoxRows:
    return read_box_rows(path, tracks=False)


@lru_cache(maxsize=FILES_KEPT)
def _export(path: Path, classes: tuple[str, ...], _state: tuple[int, int]) -> DetectorBoxes:
    return read_export(path, classes)


def _of_rows(rows: BoxRows, frames: SceneFrames, *, own: bool) -> _Found | None:
    table = rows.table
    if not len(table):
        return None
    if rows.scenes is None and not own:
        here = frames.rows_of_scene(rows.keys, table.path)
        if not len(here):  # a file of other scenes: none of its stamps or tokens is of this one
            return None
        _require_scene_known(table.path, frames)
        table, rows = table.select(here), BoxRows(table, rows.keys[here], None)
    place = frames.places_of_keys(rows.keys, table.path)
    return _Found(
        "ego",
        place,
        table["label"],
        table["score"],
        table.stacked(PLACE),
        table.stacked(SIZE),
        table["yaw"],
        table.stacked(VELOCITY),
    )


def _of_export(boxes: DetectorBoxes, frames: SceneFrames, *, own: bool) -> _Found | None:
    split = [name.rpartition("/") for name in boxes.frames]
    here = [not scene or scene == frames.scene for scene, _, _ in split]
    places = np.where(here, frames.places([name for _, _, name in split]), -1)
    if not (places >= 0).any():
        if own and boxes.frames:
            expected = f"a frame of {frames.scene} (the first is {', '.join(frames.names[0])})"
            raise DataError(boxes.path, "frame", boxes.frames[0], expected)
        return None
    if not own and not all(scene for scene, _, _ in split):
        _require_scene_known(boxes.path, frames)
    _require_all_frames(boxes.path, frames, places)
    place = places[boxes.frame]
    rows = place >= 0
    return _Found(
        "lidar",
        place[rows],
        boxes.label[rows],
        boxes.score[rows],
        boxes.centre_m[rows],
        boxes.size_m[rows],
        boxes.yaw_rad[rows],
        boxes.velocity_mps[rows],
    )


def _require_scene_known(path: Path, frames: SceneFrames) -> None:
    """Refuse frames that are called by numbers which every scene has."""
    if frames.counted:
        expected = (
            f"the scene of each frame: {SCENE} in the path of detections, names such as "
            f"{frames.scene}/{frames.names[0][0]}, or a column scene"
        )
        raise DataError(path, "frame", f"{frames.names[0][0]} of any scene", expected)


def _require_all_frames(path: Path, frames: SceneFrames, places: I64) -> None:
    """Refuse a scene with frames that the detector left out.

    KITTI's recording lacks sweeps of frames that it counts: there no detector can have run.
    """
    missing = np.setdiff1d(np.arange(len(frames.names)), places)
    if len(missing) and not frames.counted:
        name = frames.names[missing[0]][0]
        expected = f"every frame of {frames.scene}, without boxes where nothing was found"
        raise MissingError(path, f"frame {name}", "missing", expected)


def _in_world(found: _Found, frames: SceneFrames, kind: BoxFrame) -> DetectionTable:
    centre_m, yaw_rad, velocity = found.centre_m, found.yaw_rad, found.velocity_mps
    if kind == "lidar":
        mount = frames.ego_T_lidar
        centre_m, yaw_rad = mount.apply(centre_m), yaw_rad + mount.yaw_rad
        velocity = velocity @ rotation_2d(mount.yaw_rad).T
    if kind != "world":
        turn = np.array([pose.yaw_rad for pose in frames.world_T_ego])[found.place]
        cos, sin = np.cos(turn), np.sin(turn)
        vx, vy = velocity.T
        velocity = np.column_stack([cos * vx - sin * vy, sin * vx + cos * vy])
        centre_m, yaw_rad = to_world(centre_m, yaw_rad, found.place, frames.world_T_ego)
    return DetectionTable(
        frame=found.place,
        label=found.label,
        score=found.score,
        centre_m=centre_m,
        size_m=found.size_m,
        yaw_rad=wrap_angle(yaw_rad),
        velocity_mps=velocity,
    )


def located(root: Path, detections: Path | str) -> Path:
    """Return a path of detections: of the working folder where something is there, else of root."""
    path = Path(detections)
    if path.is_absolute():
        return path
    here = next(Path().glob(str(path).replace(SCENE, "*")), None)
    return root / path if here is None else path

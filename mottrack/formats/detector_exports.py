"""Results of detectors as OpenPCDet and MMDetection3D users export them: JSON and npz, no pickles.

Boxes are those of the detectors: centre x, y, z, length, width, height in metres and a heading
counter-clockwise from +x, in the frame of the LiDAR. The forms:

* OpenPCDet: a JSON list of frames, `[{"frame_id": ..., "name": [...], "score": [...],
  "boxes_lidar": [[x, y, z, dx, dy, dz, heading], ...]}, ...]`; with `"metadata": {"token": ...}` on
  nuScenes, where boxes have two more numbers, the velocity.
* MMDetection3D: a JSON file a frame, named as the point cloud, `{"labels_3d": [...],
  "scores_3d": [...], "bboxes_3d": [[x, y, z, l, w, h, yaw], ...], "box_type_3d": "LiDAR"}`, z at
  the bottom of the box; labels are numbers, whose names the user gives.
* npz: what `examples/unpickle_detections.py` makes of the pickles of both: `frames` (M,) names of
  all frames, `frame` (N,) index into them, `label` (N,) text, `score` (N,), `boxes` (N, 7 or 9).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64, Mask, Texts
from mottrack.core.errors import DataError
from mottrack.core.limits import MAX_ROWS, MAX_TEXT_BYTES
from mottrack.core.npz import unpacked_npz
from mottrack.formats.checks import (
    MAX_ANGLE_RAD,
    MAX_BOX_RANGE_M,
    MAX_BOX_SIZE_M,
)
from mottrack.formats.columns import ColumnSpec
from mottrack.formats.files import read_bytes, require_size
from mottrack.formats.json_text import parse_json
from mottrack.formats.nuscenes_tables import json_array

BOX, BOX_AND_VELOCITY = 7, 9
"""Numbers of a box: centre, size, heading; and velocity along x and y."""
LIDAR_BOX = "LiDAR"
_SCORE = ColumnSpec("score")
_ARRAYS = ("frames", "frame", "label", "score", "boxes")


class _Fields(NamedTuple):
    """What the fields of a frame are called."""

    boxes: str
    scores: str
    labels: str


OPENPCDET = _Fields("boxes_lidar", "score", "name")
MMDET3D = _Fields("bboxes_3d", "scores_3d", "labels_3d")


@dataclass(frozen=True)
class DetectorBoxes:
    """Boxes of a detector, LiDAR frame.

    frames: (M,) names of all frames on which it ran.
    frame: (N,) index into them. label: (N,). score: (N,).
    centre_m, size_m (l, w, h): (N, 3). yaw_rad: (N,).
    velocity_mps: (N, 2) NaN where the detector reports none.
    """

    path: Path
    frames: tuple[str, ...]
    frame: I64
    label: Texts
    score: F64
    centre_m: F64
    size_m: F64
    yaw_rad: F64
    velocity_mps: F64


class _Frame(NamedTuple):
    """One frame of a JSON file."""

    path: Path
    place: str
    """In error messages, before the field: "" or "frame 3, "."""
    name: str
    label: list[str]
    score: F64
    boxes: F64


def read_export(path: Path, classes: Sequence[str] = ()) -> DetectorBoxes:
    """Read an export: a json or npz file, or a folder of MMDetection3D's json files.

    Args:
        path: file or folder.
        classes: names of labels that are numbers, in the detector's order.

    Raises:
        DataError: missing or damaged file, another form, a value out of range.
    """
    if path.is_dir():
        files = sorted(path.glob("*.json"))
        if not files:
            raise DataError(path, "content", "no *.json", "a json file for each frame")
        return _joined(path, [_mmdet3d(file, _json(file), classes) for file in files])
    if path.suffix == ".npz":
        return _npz(path)
    content = _json(path)
    if isinstance(content, list):
        frames = [_openpcdet(path, i, entry, classes) for i, entry in enumerate(content)]
        return _joined(path, frames)
    return _joined(path, [_mmdet3d(path, content, classes)])


def _json(path: Path) -> Any:
    require_size(path, MAX_TEXT_BYTES.value, MAX_TEXT_BYTES.expected("bytes"))
    return parse_json(path, read_bytes(path))


def _openpcdet(path: Path, index: int, entry: Any, classes: Sequence[str]) -> _Frame:
    place = f"frame {index}, "
    if not isinstance(entry, dict):
        found = type(entry).__name__
        raise DataError(path, f"frame {index}", found, "{frame_id, name, score, boxes_lidar}")
    metadata = entry.get("metadata")
    token = metadata.get("token") if isinstance(metadata, dict) else None
    name = token if token is not None else entry.get("frame_id")
    if not isinstance(name, str | int) or isinstance(name, bool) or name == "":
        raise DataError(path, f"{place}frame_id", name, "the name of a frame")
    return _frame(
        _Frame(path, place, str(name), [], _SCORE.array([]), _SCORE.array([])),
        entry,
        OPENPCDET,
        classes,
    )


def _mmdet3d(path: Path, entry: Any, classes: Sequence[str]) -> _Frame:
    if not isinstance(entry, dict) or MMDET3D.boxes not in entry:
        expected = f"a list of frames (OpenPCDet) or {', '.join(MMDET3D)} (MMDetection3D)"
        raise DataError(path, "content", type(entry).__name__, expected)
    kind = entry.get("box_type_3d", LIDAR_BOX)
    if kind != LIDAR_BOX:
        raise DataError(path, "box_type_3d", kind, f"{LIDAR_BOX} boxes")
    empty = _Frame(path, "", path.stem, [], _SCORE.array([]), _SCORE.array([]))
    frame = _frame(empty, entry, MMDET3D, classes)
    frame.boxes[:, 2] += frame.boxes[:, 5] / 2.0  # from the bottom to the centre
    return frame


def _frame(start: _Frame, entry: dict[str, Any], names: _Fields, classes: Sequence[str]) -> _Frame:
    """Return the frame with the boxes of its entry, checked."""
    path, place = start.path, start.place
    values = []
    for name in names:
        value = entry.get(name)
        if not isinstance(value, list):
            raise DataError(path, place + name, "missing" if value is None else value, "a list")
        values.append(value)
    boxes, scores, labels = values
    if not len(boxes) == len(scores) == len(labels):
        found = f"{len(boxes)}, {len(scores)}, {len(labels)}"
        raise DataError(path, f"{place}lengths of {', '.join(names)}", found, "the same three")
    width = len(boxes[0]) if boxes and isinstance(boxes[0], list) else BOX
    array = json_array(boxes, ColumnSpec(names.boxes, width=width))
    if array is None or width not in (BOX, BOX_AND_VELOCITY):
        raise DataError(path, place + names.boxes, boxes[0], "7 or 9 finite numbers a box")
    score = json_array(scores, _SCORE)
    if score is None:
        raise DataError(path, place + names.scores, scores, "finite numbers")
    label = [_label(path, place + names.labels, value, classes) for value in labels]
    return start._replace(label=label, score=score, boxes=array.reshape(-1, width))


def _label(path: Path, field: str, value: Any, classes: Sequence[str]) -> str:
    if isinstance(value, str) and value and value.isprintable():
        return value
    if isinstance(value, int) and not isinstance(value, bool) and 0 <= value < len(classes):
        return classes[value]
    known = f" of {len(classes)}" if classes else ""
    expected = f"a name, or a number{known} with its name in dataset.detector.classes"
    raise DataError(path, field, value, expected)


def _joined(path: Path, frames: Sequence[_Frame]) -> DetectorBoxes:
    names = tuple(frame.name for frame in frames)
    repeated = (
        next((name for i, name in enumerate(names) if name in names[:i]), None)
        if len(set(names)) != len(names)
        else None
    )
    if repeated is not None:
        raise DataError(path, f"frame {repeated}", "there twice", "each frame once")
    counts = [len(frame.boxes) for frame in frames]
    boxes = [_with_velocity(frame.boxes) for frame in frames]
    return _checked(
        path,
        names,
        np.repeat(np.arange(len(frames)), counts),
        np.array([label for frame in frames for label in frame.label], np.str_),
        _Numbers(
            np.concatenate([np.zeros(0), *(frame.score for frame in frames)]),
            np.concatenate([np.zeros((0, BOX_AND_VELOCITY)), *boxes]),
        ),
    )


class _Numbers(NamedTuple):
    """Scores (N,) and boxes (N, 9), NaN for a velocity that is not known."""

    score: F64
    boxes: F64


def _with_velocity(boxes: F64) -> F64:
    if boxes.shape[1] == BOX_AND_VELOCITY:
        return boxes
    return np.column_stack([boxes, np.full((len(boxes), 2), np.nan)])


def _npz(path: Path) -> DetectorBoxes:
    require_size(path, MAX_TEXT_BYTES.value, MAX_TEXT_BYTES.expected("bytes"))
    try:
        arrays = unpacked_npz(read_bytes(path), _ARRAYS)
    except ValueError as error:
        raise DataError(path, "content", error, "an npz file") from error
    for name, kinds in zip(_ARRAYS, ("U", "iu", "U", "fiu", "fiu"), strict=True):
        found = arrays.get(name)
        if found is None or found.dtype.kind not in kinds or found.ndim != 1 + (name == "boxes"):
            shown = "missing" if found is None else f"{found.dtype} {found.shape}"
            expected = "text" if kinds == "U" else "numbers"
            raise DataError(path, name, shown, f"{expected}, (N,); boxes (N, 7) or (N, 9)")
    lengths = [len(arrays[name]) for name in _ARRAYS[1:]]
    if len(set(lengths)) != 1 or arrays["boxes"].shape[1] not in (BOX, BOX_AND_VELOCITY):
        shapes = f"{lengths}, boxes {arrays['boxes'].shape}"
        raise DataError(path, "lengths of frame, label, score, boxes", shapes, "one; 7 or 9 wide")
    frames, frame = arrays["frames"], arrays["frame"].astype(np.int64)
    if ((frame < 0) | (frame >= len(frames))).any():
        raise DataError(path, "frame", int(frame[np.argmax(frame)]), f"0 .. {len(frames) - 1}")
    if len(np.unique(frames)) != len(frames):
        raise DataError(path, "frames", "a name twice", "each frame once")
    numbers = _Numbers(
        arrays["score"].astype(np.float64), _with_velocity(arrays["boxes"].astype(np.float64))
    )
    return _checked(path, tuple(frames.tolist()), frame, arrays["label"], numbers)


def _checked(
    path: Path, frames: tuple[str, ...], frame: I64, label: Texts, numbers: _Numbers
) -> DetectorBoxes:
    score, boxes = numbers
    if len(boxes) > MAX_ROWS.value:
        raise DataError(path, "boxes", len(boxes), MAX_ROWS.expected("rows"))
    checks: tuple[tuple[Mask, str], ...] = (
        (~np.isfinite(boxes[:, :BOX]).all(axis=1) | ~np.isfinite(score), "finite numbers"),
        (np.abs(boxes[:, :3]).max(axis=1, initial=0) > MAX_BOX_RANGE_M,
         f"a place within {MAX_BOX_RANGE_M:g} m"),
        (~_sizes_in_range(boxes[:, 3:6]), f"sizes in (0, {MAX_BOX_SIZE_M:g}] m"),
        (np.abs(boxes[:, 6]) > MAX_ANGLE_RAD, "a heading in radians, at most two turns"),
    )  # fmt: skip
    for wrong, expected in checks:
        if wrong.any():
            row = int(np.argmax(wrong))
            values = boxes[row, :BOX].tolist()
            raise DataError(path, f"box of frame {frames[frame[row]]}", values, expected)
    known = np.asarray(np.isfinite(boxes[:, 7:]).all(axis=1))
    velocity = np.where(known[:, None], boxes[:, 7:], np.nan)
    return DetectorBoxes(
        path, frames, frame, label, score, boxes[:, :3], boxes[:, 3:6], boxes[:, 6], velocity
    )


def _sizes_in_range(size_m: F64) -> Mask:
    return np.asarray(((size_m > 0.0) & (size_m <= MAX_BOX_SIZE_M)).all(axis=1))

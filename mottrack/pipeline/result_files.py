"""Result files of any tracker as scenes with truth: nuScenes submissions and KITTI results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mottrack.core import Frame, SceneResult
from mottrack.core.arrays import Mask
from mottrack.core.interfaces import Scene
from mottrack.core.scene_objects import SceneObjects
from mottrack.core.tables import ALL_AROUND_RAD, FrameTable, TrackTable, TruthTable
from mottrack.datasets.kitti.labels import read_detection_file
from mottrack.datasets.nuscenes.config import NuScenesConfig
from mottrack.datasets.nuscenes.dataset import NuScenes
from mottrack.eval.kitti.boxes import KittiBoxes
from mottrack.eval.kitti.files import Folders, read_folders
from mottrack.eval.kitti.matching import NEIGHBOURS, KittiRules
from mottrack.eval.nuscenes.command import Request, check, ground_truth
from mottrack.eval.nuscenes.submission import Box, Submission, read_submission
from mottrack.eval.nuscenes.submission_checks import raise_all
from mottrack.eval.scores import ScoreConfig, ScoreFilter
from mottrack.eval.tracked_scenes import TrackedScenes, Values
from mottrack.formats.nuscenes_classes import CLASSES
from mottrack.formats.nuscenes_tables import NuScenesTables
from mottrack.formats.rigid import quaternion_yaws

KITTI_HZ = 10.0  # rate of the Velodyne HDL-64E in KITTI
OCCLUSION = "occlusion"
_OCCLUDED = ("visible", "partly", "largely", "unknown")
"""KITTI's own grades, 0 to 3."""


@dataclass(frozen=True)
class SubmissionFiles:
    """A nuScenes tracking submission and, where they are known, the detections behind it."""

    request: Request
    detections: Path | None = None


def of_submission(files: SubmissionFiles) -> TrackedScenes:
    """Read a nuScenes tracking submission, its boxes as submitted: no gap is filled.

    Raises:
        SubmissionError: with every problem of the file.
        DataError: the tables are not usable.
    """
    request = files.request
    submission = read_submission(request.submission)
    problems = check(request, submission, ground_truth(request))
    if any(problem.severity == "error" for problem in problems):
        raise_all(problems)
    config = NuScenesConfig(
        root=request.dataroot,
        version=request.version,
        split=request.split,
        rate_hz=2,
        detections=files.detections,
    )
    dataset = NuScenes(config)
    results = tuple(submission_results(dataset, submission))
    objects = tuple(map(_detections, map(dataset.scene, dataset.scene_names)))
    columns = _scene_attributes(request, dataset.scene_names)
    return TrackedScenes(results, ScoreConfig(), objects, velocities="observed", columns=columns)


def _scene_attributes(request: Request, names: Sequence[str]) -> dict[str, list[Values]]:
    """Return place, light and weather of every scene, as its log and its description tell them."""
    tables = NuScenesTables(request.dataroot, request.version)
    place = {str(row["token"]): str(row.get("location", "")) for row in tables.rows("log")}
    found: dict[str, dict[str, str]] = {}
    for row in tables.rows("scene"):
        words = str(row.get("description", "")).lower()
        found[str(row["name"])] = {
            "location": place.get(str(row.get("log_token")), ""),
            "light": "" if not words else "night" if "night" in words else "day",
            "weather": "" if not words else "rain" if "rain" in words else "dry",
        }
    kinds = ("location", "light", "weather")
    return {kind: [{None: found[name][kind]} for name in names] for kind in kinds}


def _detections(scene: Scene) -> SceneObjects | None:
    """Return the detections of a scene; None where there is no file of them."""
    frames = [scene.frame(index) for index in range(len(scene))]
    given = [(k, frame.detections) for k, frame in enumerate(frames)]
    found = [SceneObjects.at(k, boxes) for k, boxes in given if boxes is not None]
    return SceneObjects.stacked(found) if found else None


def submission_results(dataset: NuScenes, submission: Submission) -> list[SceneResult]:
    """Return truth and submitted tracks of every scene of the split.

    A box whose velocity is NaN has velocity 0 here and is marked as not observed.
    """
    results = []
    for name in dataset.scene_names:
        scene = dataset.scene(name)
        frames = [scene.frame(i) for i in range(len(scene))]
        tracks = _tracks(frames, submission.results)
        truth = TruthTable.of(frames)
        table = FrameTable.of(frames)
        results.append(SceneResult(name, table, truth, tracks, classes=tuple(CLASSES)))
    return results


def _tracks(frames: Sequence[Frame], boxes_of: dict[str, list[Box]]) -> TrackTable:
    boxes = [(i, box) for i, f in enumerate(frames) for box in boxes_of.get(f.token, ())]
    if not boxes:
        return TrackTable.empty()
    velocity = np.array([box["velocity"] for _, box in boxes], np.float64)
    names = np.array([str(box["tracking_id"]) for _, box in boxes])
    columns = {
        name: np.array([box[name] for _, box in boxes], np.float64)
        for name in ("translation", "size", "rotation", "tracking_score")
    }
    count = len(boxes)
    known: Mask = np.asarray(np.isfinite(velocity).all(axis=1))
    return TrackTable(
        frame=np.array([frame for frame, _ in boxes]),
        id=np.unique(names, return_inverse=True)[1],
        label=np.array([box["tracking_name"] for _, box in boxes]),
        centre_m=columns["translation"],
        size_m=columns["size"][:, [1, 0, 2]],
        yaw_rad=quaternion_yaws(columns["rotation"]),
        velocity_mps=np.where(known[:, None], velocity, 0.0),
        velocity_covariance_m2ps2=np.tile(np.eye(2), (count, 1, 1)),
        score=columns["tracking_score"],
        observed=known,
        hull_corners=np.zeros(count, np.int64),
    )


def of_kitti(folders: Folders, kind: str, detections: Path | None = None) -> TrackedScenes:
    """Read one class of KITTI labels and results; every track box counts, whatever its score.

    The files have no velocities and no returns; the world is the camera's frame, seen from above.

    Args:
        folders: labels and results.
        kind: class in lower case.
        detections: folder with `<Class>/<sequence>.txt` in AB3DMOT's format; None: not known.

    Raises:
        DataError: a file is missing or malformed.
        ConfigError: the class is unknown.
    """
    pairs = read_folders(folders, KittiRules(kind=kind))
    results, objects, hidden = [], [], []
    for name, pair in zip(folders.sequences, pairs, strict=True):
        labels = pair.labels.select(pair.labels.id >= 0)  # regions without labels have none
        results.append(_sequence(name, labels, pair.results.select(pair.results.kind == kind)))
        last = len(results[-1].frames)
        found = None if detections is None else _kitti_detections(detections, name, kind)
        objects.append(None if found is None else found.select(found.frame < last))
        hidden.append(_occlusion(labels))
    return TrackedScenes(
        tuple(results),
        ScoreConfig(),
        tuple(objects),
        velocities="none",
        columns={OCCLUSION: hidden},
        counted=(ScoreFilter(kind),),
        alike={kind: NEIGHBOURS[kind]},
    )


def _sequence(name: str, labels: KittiBoxes, said: KittiBoxes) -> SceneResult:
    frames = int(max(labels.frame.max(initial=-1), said.frame.max(initial=-1), 0)) + 1
    labels, said = (b.select(np.argsort(b.frame, kind="stable")) for b in (labels, said))
    unknown = np.full((len(labels), 2), np.nan)
    truth = TruthTable(
        **_boxes(labels),
        velocity_mps=unknown,
        num_points=np.full(len(labels), -1),
        interpolated=np.zeros(len(labels), np.bool_),
    )
    count = len(said)
    tracks = TrackTable(
        **_boxes(said),
        velocity_mps=np.zeros((count, 2)),
        velocity_covariance_m2ps2=np.tile(np.eye(2), (count, 1, 1)),
        score=said.score,
        observed=np.ones(count, np.bool_),
        hull_corners=np.zeros(count, np.int64),
    )
    table = FrameTable(
        stamp_ns=(np.arange(frames) * round(1e9 / KITTI_HZ)).astype(np.int64),
        token=np.array([f"{k:06d}" for k in range(frames)]),
        world_T_ego=np.tile(np.eye(4), (frames, 1, 1)),
        labelled_azimuth_rad=np.tile(ALL_AROUND_RAD, (frames, 1)),
        annotated=np.ones(frames, np.bool_),
    )
    return SceneResult(name, table, truth, tracks)


def _boxes(boxes: KittiBoxes) -> dict[str, Any]:
    return {
        "frame": boxes.frame,
        "id": boxes.id,
        "label": boxes.kind,
        "centre_m": boxes.box[:, :3],
        "size_m": boxes.box[:, 3:6],
        "yaw_rad": boxes.box[:, 6],
    }


def _occlusion(labels: KittiBoxes) -> Values:
    keys = zip(labels.frame.tolist(), labels.id.tolist(), strict=True)
    grades = np.clip(labels.occlusion, 0, len(_OCCLUDED) - 1).astype(int).tolist()
    return {key: _OCCLUDED[grade] for key, grade in zip(keys, grades, strict=True)}


def _kitti_detections(folder: Path, sequence: str, kind: str) -> SceneObjects:
    table = read_detection_file(folder / kind.capitalize() / f"{sequence}.txt")
    count, order = len(table), np.argsort(table["frame"], kind="stable")
    height = table["h"]
    return SceneObjects(
        label=np.char.lower(table["type"]),
        centre_m=np.column_stack([table["x"], table["z"], -table["y"] + height / 2]),
        size_m=table.stacked(("l", "w", "h")),
        yaw_rad=-table["ry"],
        score=table["score"],
        velocity_mps=np.full((count, 2), np.nan),
        frame=table["frame"],
    ).select(order)

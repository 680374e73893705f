"""Records and sweep files that one scene adds to a nuScenes data set."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection
from pathlib import Path

import numpy as np

from mottrack.core import Frame, InputError, Objects, Pose, Scene, Sweep, Truth
from mottrack.datasets.counting import counted_points
from mottrack.datasets.nuscenes.static_rows import attribute_of, token_of
from mottrack.datasets.nuscenes.style import (
    NUSCENES_STYLE,
    FileName,
    Part,
    Step,
    Style,
    microseconds,
)
from mottrack.datasets.nuscenes.submission import box_geometry
from mottrack.datasets.nuscenes.visibility import visibilities
from mottrack.formats.rigid import quaternion_wxyz
from mottrack.formats.table_stream import Row


class SceneRows:
    """Collects what one scene adds to the tables; writes its sweeps on the way."""

    def __init__(self, name: str, root: Path, style: Style = NUSCENES_STYLE) -> None:
        self._name, self._root, self._style = name, root, style
        self._samples: list[str] = []
        self._boxes: dict[int, list[Row]] = defaultdict(list)
        self._category: dict[int, str] = {}
        self.tables: dict[str, list[Row]] = defaultdict(list)
        self.detections: dict[str, list[Row]] = {}

    def add_all(self, scene: Scene) -> None:
        """Add every frame of a scene, then what refers to the whole of it."""
        waiting: list[Row] = []
        for index in range(len(scene)):
            frame = scene.frame(index)
            sweep = scene.sweep(index) if scene.has_sweeps else None
            beside = index + 1 if index + 1 < len(scene) else index - 1
            step = Step(frame, sweep, scene.frame(beside) if beside >= 0 else None)
            waiting += [self._sample_data(index, frame, part) for part in self._style.parts(step)]
            if frame.is_key:
                self._add_key_frame(frame, sweep)
                # a sweep between key frames belongs to the next one
                self._assign(waiting, self._samples[-1])
                waiting = []
        if not self._samples:
            raise InputError("key frames", 0, f"at least one in scene {scene.name}")
        self._assign(waiting, self._samples[-1])
        self._finish()

    @property
    def categories(self) -> frozenset[str]:
        """The categories of the objects so far."""
        return frozenset(self._category.values())

    def _assign(self, waiting: list[Row], sample: str) -> None:
        self.tables["sample_data"].extend(row | {"sample_token": sample} for row in waiting)

    def _sample_data(self, index: int, frame: Frame, part: Part) -> Row:
        style, stamp_us = self._style, part.stamp_us
        name = FileName(self._name, part.channel, index, stamp_us, frame.is_key)
        file = style.file(name)
        style.write(self._root / file, part)
        token = token_of("sample_data", self._name, part.channel, index)
        self._add("ego_pose", {"token": token, "timestamp": stamp_us, **_placed(part.world_T_ego)})
        return {
            "token": token,
            "ego_pose_token": token,
            "calibrated_sensor_token": self._calibration(part),
            "timestamp": stamp_us,
            "fileformat": style.fileformat,
            "is_key_frame": frame.is_key,
            "height": 0,
            "width": 0,
            "filename": file,
            **style.further("sample_data"),
        }

    def _calibration(self, part: Part) -> str:
        origin_m = part.ego_T_lidar.translation_m.tolist()
        token = token_of("calibrated_sensor", self._name, part.channel, origin_m)
        if all(row["token"] != token for row in self.tables["calibrated_sensor"]):
            row = {
                "token": token,
                "sensor_token": token_of("sensor", part.channel),
                **_placed(part.ego_T_lidar),
                "camera_intrinsic": [],
            }
            self._add("calibrated_sensor", row)
        return token

    def _add(self, table: str, row: Row) -> None:
        """Add a record with the fields that the dialect has beside nuScenes' own."""
        self.tables[table].append(row | self._style.further(table))

    def _add_key_frame(self, frame: Frame, sweep: Sweep | None) -> None:
        token = token_of("sample", self._name, len(self._samples))
        self._samples.append(token)
        self.tables["sample"].append(
            {
                "token": token,
                "timestamp": microseconds(frame),
                "scene_token": token_of("scene", self._name),
            }
        )
        if frame.truth is not None:
            self._add_boxes(token, frame.truth, sweep)
        if frame.detections is not None:
            names = self._style.dialect.detection_names
            self.detections[token] = detection_rows(token, frame.detections, names)

    def _add_boxes(self, sample: str, truth: Truth, sweep: Sweep | None) -> None:
        points = counted_points(truth, sweep)
        visibility = visibilities(truth, sweep)
        geometry = box_geometry(truth)
        for i, identity in enumerate(truth.id.tolist()):
            category = self._category.setdefault(
                identity, self._style.category(str(truth.label[i]))
            )
            attribute = attribute_of(category, float(np.hypot(*truth.velocity_mps[i])))
            row = {
                "token": token_of("annotation", sample, identity),
                "sample_token": sample,
                "instance_token": token_of("instance", self._name, identity),
                "visibility_token": visibility[i],
                "attribute_tokens": [token_of("attribute", attribute)] if attribute else [],
                **geometry[i],
                "num_lidar_pts": int(points[i]),
                "num_radar_pts": 0,
                **self._style.further("sample_annotation"),
            }
            self._boxes[identity].append(row)

    def _finish(self) -> None:
        _chain(self.tables["sample"])
        sensor_of = {m["token"]: m["sensor_token"] for m in self.tables["calibrated_sensor"]}
        by_sensor: dict[str, list[Row]] = defaultdict(list)
        for row in self.tables["sample_data"]:
            by_sensor[sensor_of[row["calibrated_sensor_token"]]].append(row)
        for rows in by_sensor.values():
            _chain(rows)
        for identity, rows in self._boxes.items():
            _chain(rows)
            self.tables["sample_annotation"].extend(rows)
            self._add(
                "instance",
                {
                    "token": rows[0]["instance_token"],
                    "category_token": token_of("category", self._category[identity]),
                    "nbr_annotations": len(rows),
                    "first_annotation_token": rows[0]["token"],
                    "last_annotation_token": rows[-1]["token"],
                },
            )
        self.tables["scene"].append(
            {
                "token": token_of("scene", self._name),
                "log_token": token_of("log", self._name),
                "nbr_samples": len(self._samples),
                "first_sample_token": self._samples[0],
                "last_sample_token": self._samples[-1],
                "name": self._name,
                "description": "written by mottrack",
            }
        )


def detection_rows(sample: str, found: Objects, names: Collection[str]) -> list[Row]:
    """Return the boxes of one sample in the official detection format."""
    geometry = box_geometry(found)
    rows = []
    for i, label in enumerate(found.label.tolist()):
        if label in names:
            rows.append(
                {
                    "sample_token": sample,
                    **geometry[i],
                    "velocity": _velocity(found, i),
                    "detection_name": label,
                    "detection_score": float(found.score[i]),
                    "attribute_name": "",
                }
            )
    return rows


def _velocity(found: Objects, index: int) -> list[float]:
    """Return NaN where no velocity was measured, as detectors write it: zero would say at rest."""
    if found.velocity is None or not found.velocity.valid[index]:
        return [float("nan")] * 2
    x, y = found.velocity.mean_mps[index].tolist()
    return [x, y]


def _chain(rows: list[Row]) -> None:
    """Link records in order by `prev` and `next`."""
    tokens = ["", *(row["token"] for row in rows), ""]
    for i, row in enumerate(rows):
        row["prev"], row["next"] = tokens[i], tokens[i + 2]


def _placed(pose: Pose) -> Row:
    return {
        "translation": pose.translation_m.tolist(),
        "rotation": quaternion_wxyz(pose.rotation).tolist(),
    }

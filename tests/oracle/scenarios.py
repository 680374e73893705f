"""Small random data sets in nuScenes format, full of what official rules trip over."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np

CATEGORIES = {
    "vehicle.bicycle": "bicycle",
    "vehicle.bus.bendy": "bus",
    "vehicle.bus.rigid": "bus",
    "vehicle.car": "car",
    "vehicle.motorcycle": "motorcycle",
    "human.pedestrian.adult": "pedestrian",
    "human.pedestrian.child": "pedestrian",
    "vehicle.trailer": "trailer",
    "vehicle.truck": "truck",
    "human.pedestrian.stroller": None,
    "static_object.bicycle_rack": None,
}
SCENES = ("scene-0003", "scene-0012", "scene-0013")
FIXED = {
    "attribute": [],
    "visibility": [{"token": "1", "level": "v", "description": ""}],
    "log": [
        {
            "token": "l",
            "logfile": "l",
            "vehicle": "v",
            "date_captured": "d",
            "location": "boston-seaport",
        }
    ],
    "map": [{"token": "m", "log_tokens": ["l"], "category": "c", "filename": "maps/m.png"}],
    "sensor": [{"token": "s", "channel": "LIDAR_TOP", "modality": "lidar"}],
    "calibrated_sensor": [
        {
            "token": "c",
            "sensor_token": "s",
            "translation": [0, 0, 0],
            "rotation": [1, 0, 0, 0],
            "camera_intrinsic": [],
        }
    ],
    "category": [
        {"token": name, "name": name, "description": "", "index": k}
        for k, name in enumerate(CATEGORIES)
    ],
}
Row = dict[str, Any]


class Scenario:
    """One data set and one submission, drawn from a seed."""

    def __init__(self, seed: int, *, duplicates: bool = True) -> None:
        self.rng = np.random.default_rng(seed)
        self.duplicates = duplicates
        self.tables: dict[str, list[Row]] = {
            name: [] for name in ("scene", "sample", "sample_data", "ego_pose", "instance")
        }
        self.annotations: list[Row] = []
        self.results: dict[str, list[Row]] = {}
        self.scenes = SCENES[: int(self.rng.integers(1, 4))]
        self.ties = self.rng.random() < 0.3
        self.spread = float(self.rng.choice([6.0, 25.0, 40.0]))
        self.noise = float(self.rng.choice([0.0, 0.2, 0.8]))
        self.kinds = list(self.rng.permutation(list(CATEGORIES))[: self.rng.integers(2, 12)])
        for number, name in enumerate(self.scenes):
            self._scene(number, name)
        if not any(self.results.values()):
            first = next(iter(self.results))
            self.results[first].append(self._box(first, ("x", "car"), self.origin + 1.0, 0.5))

    def _scene(self, number: int, name: str) -> None:
        rng = self.rng
        frames = int(rng.integers(2, 12))
        origin = self.origin = rng.uniform(-2000, 2000, 3) * [1, 1, 0.01]
        tokens = [f"{number:02d}{k:030d}" for k in range(frames)]
        stamps = 10**15 + number * 10**9 + np.cumsum(rng.integers(450_000, 560_000, frames))
        self.tables["scene"].append(
            {"token": name, "log_token": "l", "nbr_samples": frames, "name": name}
            | {"first_sample_token": tokens[0], "last_sample_token": tokens[-1], "description": ""}
        )
        around = ["", *tokens, ""]
        for k, token in enumerate(tokens):
            link = {"prev": around[k], "next": around[k + 2]}
            stamp = {"token": token, "timestamp": int(stamps[k])}
            self.tables["sample"].append(stamp | link | {"scene_token": name})
            ego = (origin + rng.normal(0, 2, 3)).tolist()
            self.tables["ego_pose"].append(stamp | {"translation": ego, "rotation": [1, 0, 0, 0]})
            self.tables["sample_data"].append(
                stamp
                | {"sample_token": token, "ego_pose_token": token, "calibrated_sensor_token": "c"}
                | {"fileformat": "pcd", "is_key_frame": True, "height": 0, "width": 0}
                | {"filename": "x", "prev": "", "next": ""}
            )
            self.results[token] = []
        for track in range(int(rng.integers(1, 14))):
            self._track(f"{number}-{track}", tokens, origin)

    def _track(self, name: str, tokens: list[str], origin: np.ndarray) -> None:
        rng = self.rng
        kind = str(rng.choice(self.kinds))
        start, step = (
            origin + rng.uniform(-1, 1, 3) * self.spread * [1, 1, 0],
            rng.normal(0, 1, 3) * [1, 1, 0],
        )
        centre = start + np.arange(len(tokens))[:, None] * step * (rng.random() < 0.7)
        size = [6.0, 8.0, 9.0] if kind.startswith("static") else [1.5, 3.0, 1.6]
        annotated = [k for k in range(len(tokens)) if rng.random() < 0.8]
        self._annotate(name, kind, [(tokens[k], centre[k].tolist(), size) for k in annotated])
        label = CATEGORIES[kind] or "bicycle"
        identity, score = name, float(rng.random())
        for k, token in enumerate(tokens):
            if rng.random() < 0.06:
                identity += "x"
            if rng.random() < 0.03:
                label = str(rng.choice(["car", "truck", "bicycle"]))
            if rng.random() < 0.75:
                near = centre[k] + rng.normal(0, 1, 3) * self.noise
                mark = (
                    score
                    if rng.random() < 0.5
                    else float(np.clip(score + rng.normal(0, 0.1), 0, 1))
                )
                self.results[token].append(self._box(token, (identity, label), near, mark))
            if rng.random() < 0.05 and self.duplicates:
                again = centre[k] + rng.normal(0, 1.0, 3)
                self.results[token].append(self._box(token, (identity, label), again, score))
            if rng.random() < 0.08:
                false = origin + rng.uniform(-1, 1, 3) * self.spread
                self.results[token].append(
                    self._box(token, (f"{identity}f", label), false, score / 2)
                )

    def _annotate(
        self, name: str, kind: str, boxes: list[tuple[str, list[float], list[float]]]
    ) -> None:
        if not boxes:
            return
        tokens = [f"{name}@{k}" for k in range(len(boxes))]
        self.tables["instance"].append(
            {"token": name, "category_token": kind, "nbr_annotations": len(boxes)}
            | {"first_annotation_token": tokens[0], "last_annotation_token": tokens[-1]}
        )
        around = ["", *tokens, ""]
        turn = float(self.rng.uniform(-3, 3))
        for k, (sample, centre, size) in enumerate(boxes):
            self.annotations.append(
                {"token": tokens[k], "sample_token": sample, "instance_token": name}
                | {"visibility_token": "1", "attribute_tokens": [], "size": size}
                | {"translation": centre, "prev": around[k], "next": around[k + 2]}
                | {"rotation": [float(np.cos(turn / 2)), 0.0, 0.0, float(np.sin(turn / 2))]}
                | {"num_lidar_pts": int(self.rng.integers(0, 4))}
                | {"num_radar_pts": int(self.rng.integers(0, 2))}
            )

    def _box(self, sample: str, what: tuple[str, str], centre: np.ndarray, score: float) -> Row:
        box = {
            "sample_token": sample,
            "translation": centre.tolist(),
            "size": [1.5, 3.0, 1.6],
            "rotation": [1.0, 0.0, 0.0, 0.0],
            "velocity": [0.0, 0.0],
            "tracking_id": what[0],
            "tracking_name": what[1],
            "tracking_score": round(score, 1) if self.ties else score,
        }
        if self.rng.random() < 0.03:
            box["num_pts"] = int(self.rng.integers(0, 3))
        return box

    def write(self, root: Path) -> None:
        """Writes tables, submission.json and scenes.txt, replacing what was there."""
        shutil.rmtree(root, ignore_errors=True)
        (root / "v1.0-trainval").mkdir(parents=True)
        (root / "maps").mkdir()
        (root / "maps/m.png").write_bytes(b"")
        tables = FIXED | self.tables | {"sample_annotation": self.annotations}
        for name, rows in tables.items():
            (root / "v1.0-trainval" / f"{name}.json").write_text(json.dumps(rows))
        meta = {f"use_{x}": False for x in ("camera", "lidar", "radar", "map", "external")}
        (root / "submission.json").write_text(json.dumps({"meta": meta, "results": self.results}))
        (root / "scenes.txt").write_text("\n".join(self.scenes))

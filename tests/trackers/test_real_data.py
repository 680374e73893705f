"""Real detections of real scenes, by the official metric: the published row, and better."""

import json
import shutil
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from mottrack.core.objects import Objects, Tracks
from mottrack.eval.nuscenes.command import Request, run
from mottrack.trackers import KalmanTracker


class Sample(NamedTuple):
    token: str
    objects: Objects


@pytest.fixture(scope="module")
def timed_root(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tables with the real times of the key frames."""
    root = tmp_path_factory.mktemp("timed") / "nuscenes"
    shutil.copytree(shared_data / "nuscenes_mini" / "v1.0-mini", root / "v1.0-mini")
    for table in (shared_data / "nuscenes_mini" / "timed_tables").glob("*.json"):
        place = root / "v1.0-mini" / table.name
        place.unlink()
        shutil.copyfile(table, place)
    return root


def stream_of(root: Path, scene: str, file: Path) -> list[Sample]:
    """Sample tokens and detections of a scene, in order of time."""
    tables = root / "v1.0-mini"
    samples = {s["token"]: s for s in json.loads((tables / "sample.json").read_text())}
    scenes = json.loads((tables / "scene.json").read_text())
    token = next(s["first_sample_token"] for s in scenes if s["name"] == scene)
    found = json.loads(file.read_text())["results"]
    frames = []
    while token:
        stamp_ns = samples[token]["timestamp"] * 1000
        frames.append(Sample(token, objects_of(found[token], stamp_ns)))
        token = samples[token]["next"]
    return frames


def objects_of(boxes: list[dict[str, Any]], stamp_ns: int) -> Objects:
    w, x, y, z = np.array([b["rotation"] for b in boxes]).T
    return Objects(
        stamp_ns=stamp_ns,
        frame="world",
        centre_m=np.array([b["translation"] for b in boxes]),
        size_m=np.array([b["size"] for b in boxes])[:, [1, 0, 2]],
        yaw_rad=np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
        label=np.array([b["detection_name"] for b in boxes]),
        score=np.array([b["detection_score"] for b in boxes]),
    )


def rows(token: str, tracks: Tracks) -> list[dict[str, Any]]:
    return [
        {
            "sample_token": token,
            "translation": tracks.centre_m[i].tolist(),
            "size": tracks.size_m[i, [1, 0, 2]].tolist(),
            "rotation": [np.cos(tracks.yaw_rad[i] / 2), 0, 0, np.sin(tracks.yaw_rad[i] / 2)],
            "velocity": tracks.velocity_mps[i].tolist(),
            "tracking_id": str(tracks.id[i]),
            "tracking_name": str(tracks.label[i]),
            "tracking_score": float(tracks.score[i]),
        }
        for i in range(len(tracks))
    ]


def evaluate(root: Path, files: dict[str, Path], preset: str, folder: Path) -> dict[str, float]:
    """Official metrics of a preset over scenes with a detection file each."""
    results = {}
    for scene, file in files.items():
        tracker = KalmanTracker(KalmanTracker.Config(preset=preset))
        for token, objects in stream_of(root, scene, file):
            results[token] = rows(token, tracker.step(objects.stamp_ns, objects))
    used = {f"use_{w}": w == "lidar" for w in ("camera", "lidar", "radar", "map", "external")}
    submission, split = folder / "submission.json", folder / "scenes.txt"
    submission.write_text(json.dumps({"meta": used, "results": results}))
    split.write_text("\n".join(files) + "\n")
    return run(Request(root, "v1.0-mini", str(split), submission)).metrics.total


def test_the_published_row(tmp_path: Path, shared_data: Path) -> None:
    root = shared_data / "nuscenes_mini"
    files = {"scene-0103": root / "detections" / "centerpoint_scene-0103.json"}
    found = evaluate(root, files, "stanford_iprl_tri", tmp_path)
    assert (round(found["amota"], 3), round(found["mota"], 3)) == (0.453, 0.415)
    assert found["ids"] == 28


@pytest.mark.parametrize(
    ("detector", "peer_amota", "peer_ids"), [("megvii", 0.775, 32), ("centerpoint", 0.725, 9)]
)
def test_the_default_is_ahead_of_the_best_peer(
    timed_root: Path,
    shared_data: Path,
    tmp_path: Path,
    detector: str,
    peer_amota: float,
    peer_ids: int,
) -> None:
    """Poly-MOT's figures on the same detections, at its published settings."""
    folder = shared_data / "nuscenes_mini" / "detections"
    files = {p.stem.rpartition("_")[2]: p for p in sorted(folder.glob(f"{detector}*.json"))}
    found = evaluate(timed_root, files, "default", tmp_path)
    assert found["amota"] > peer_amota
    assert found["ids"] <= peer_ids

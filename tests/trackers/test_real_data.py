"""Real detections of a real scene, by the official metric: the published row, and better."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mottrack.core.objects import Objects, Tracks
from mottrack.eval.nuscenes.command import Request, run
from mottrack.trackers import KalmanTracker

SCENE = "scene-0103"
Stream = list[tuple[str, Objects]]


@pytest.fixture(scope="module")
def stream(shared_data: Path) -> Stream:
    """Sample tokens and CenterPoint detections of the scene, in order of time."""
    folder = shared_data / "nuscenes_mini"
    tables = folder / "v1.0-mini"
    samples = {s["token"]: s for s in json.loads((tables / "sample.json").read_text())}
    scenes = json.loads((tables / "scene.json").read_text())
    token = next(s["first_sample_token"] for s in scenes if s["name"] == SCENE)
    file = folder / "detections" / f"centerpoint_{SCENE}.json"
    found = json.loads(file.read_text())["results"]
    frames = []
    while token:
        stamp_ns = samples[token]["timestamp"] * 1000
        frames.append((token, objects_of(found[token], stamp_ns)))
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


def evaluate(stream: Stream, preset: str, folder: Path, shared_data: Path) -> dict[str, float]:
    tracker = KalmanTracker(KalmanTracker.Config(preset=preset))
    results = {token: rows(token, tracker.step(o.stamp_ns, o)) for token, o in stream}
    used = {f"use_{w}": w == "lidar" for w in ("camera", "lidar", "radar", "map", "external")}
    submission, split = folder / "submission.json", folder / "scenes.txt"
    submission.write_text(json.dumps({"meta": used, "results": results}))
    split.write_text(f"{SCENE}\n")
    root = shared_data / "nuscenes_mini"
    return run(Request(root, "v1.0-mini", str(split), submission)).metrics.total


def test_the_published_row(stream: Stream, tmp_path: Path, shared_data: Path) -> None:
    found = evaluate(stream, "stanford_iprl_tri", tmp_path, shared_data)
    assert (round(found["amota"], 3), round(found["mota"], 3)) == (0.453, 0.415)
    assert found["ids"] == 28


def test_the_default_beats_the_peers(stream: Stream, tmp_path: Path, shared_data: Path) -> None:
    found = evaluate(stream, "default", tmp_path, shared_data)
    assert found["amota"] > 0.66
    assert found["ids"] <= 14

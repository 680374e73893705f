"""A small scene as stored results: straight tracks, and what a tracker made of them."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from mottrack.core import FlowSamples, FrameTable, SceneResult, TrackTable, TruthTable


def make_tables(rows: list[dict[str, Any]], frames: int) -> SceneResult:
    """A scene from rows of side ("truth" or "track"), frame, id, label, x, y, velocity, ...."""
    sides: dict[str, list[dict[str, Any]]] = {"truth": [], "track": []}
    for row in rows:
        sides[row["side"]].append(row)
    stamps = np.arange(frames) * 500_000_000
    poses = np.tile(np.eye(4), (frames, 1, 1))
    hulls = [np.array(row.get("hull", np.zeros((0, 2)))) for row in sides["track"]]
    return SceneResult(
        "scene",
        FrameTable(
            stamps,
            np.array([str(k) for k in range(frames)]),
            poses,
            np.tile([-np.pi, np.pi], (frames, 1)),
            np.ones(frames, np.bool_),
        ),
        TruthTable(
            **_columns(sides["truth"]),
            num_points=np.array([row.get("points", 5) for row in sides["truth"]], np.int64),
            interpolated=np.array([row.get("interpolated", False) for row in sides["truth"]], bool),
        ),
        TrackTable(
            **_columns(sides["track"]),
            velocity_covariance_m2ps2=np.zeros((len(sides["track"]), 2, 2)),
            score=np.array([row.get("score", 0.9) for row in sides["track"]], np.float64),
            observed=np.array([row.get("observed", True) for row in sides["track"]], bool),
            hull_corners=np.array([len(hull) for hull in hulls], np.int64),
        ),
        FlowSamples.empty(),
        np.concatenate([*hulls, np.zeros((0, 2))]),
    )


def _columns(rows: list[dict[str, Any]]) -> dict[str, Any]:
    n = len(rows)
    return {
        "frame": np.array([row["frame"] for row in rows], np.int64),
        "id": np.array([row["id"] for row in rows], np.int64),
        "label": np.array([row.get("label", "car") for row in rows], np.str_),
        "centre_m": np.array([(row["x"], row.get("y", 0.0), 0.0) for row in rows]).reshape(n, 3),
        "size_m": np.array([row.get("size", (4.0, 2.0, 1.5)) for row in rows]).reshape(n, 3),
        "yaw_rad": np.array([row.get("yaw", 0.0) for row in rows]),
        "velocity_mps": np.array([row.get("velocity", (0.0, 0.0)) for row in rows]).reshape(n, 2),
    }


@pytest.fixture
def make_result() -> Callable[[list[dict[str, Any]], int], SceneResult]:
    return make_tables

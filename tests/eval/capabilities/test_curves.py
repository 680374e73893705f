"""Curves of a scene that can be worked out by hand, and the command over files."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from mottrack.cli import app
from mottrack.core.errors import InputError
from mottrack.eval.capabilities.curves import CAPABILITIES, Curves, curves
from mottrack.eval.capabilities.tracking import Side, Tracking

Row = tuple[int, int, float, float]
"""Frame, identity, position along x, speed along x."""


def side(rows: Sequence[Row]) -> Side:
    values = np.array(sorted(rows), np.float64).reshape(-1, 4)
    flat = np.zeros(len(values))
    return Side(
        values[:, 0].astype(np.int64),
        values[:, 1].astype(np.int64),
        np.column_stack([values[:, 2], flat]),
        np.column_stack([values[:, 3], flat]),
        np.abs(values[:, 2]),
        np.full(len(values), 7),
    )


def drive(
    truth: Sequence[Row],
    tracks: Sequence[Row],
    frames: int = 12,
    detections: Sequence[Row] | None = None,
) -> Curves:
    """One frame each half second."""
    stamps = np.arange(frames) * 0.5
    objects = None if detections is None else side(detections)
    spent = np.full(frames, 2e-3)
    return curves([(Tracking(stamps, side(truth), side(tracks), spent, objects),)], 10)


def values(found: Curves, name: str) -> dict[float, tuple[float, int]]:
    return {p.low: (p.value, p.events) for p in found[name] if p.events}


def test_gaps_by_their_length() -> None:
    truth = [(f, 1, 0.0, 0.0) for f in range(12)]
    tracks = [(f, 7, 0.0, 0.0) for f in (0, 1, 3)] + [(f, 8, 0.0, 0.0) for f in (7, 8)]
    found = values(drive(truth, tracks), "identity_over_gap")
    # frame 1 to 3 is a second and keeps 7; 3 to 7 are two, and the object becomes 8
    assert found == {0.75: (1.0, 1), 1.25: (0.0, 1)}


def test_latency_counts_objects_that_never_come() -> None:
    truth = [(f, i, 10.0 * i, 0.0) for f in range(12) for i in (1, 2)]
    tracks = [(f, 7, 10.0, 0.0) for f in range(3, 12)]
    found = values(drive(truth, tracks), "latency")
    assert {limit: value for limit, (value, _) in found.items()} == {
        0.0: 0.0, 0.5: 0.0, 1.0: 0.0, 1.5: 0.5, 2.0: 0.5, 3.0: 0.5, 5.0: 0.5,
    }  # fmt: skip


def test_latency_from_the_first_detection_leaves_undetected_objects_out() -> None:
    truth = [(f, i, 10.0 * i, 0.0) for f in range(12) for i in (1, 2)]
    detections = [(f, f, 10.3, 0.0) for f in range(2, 12)]
    tracks = [(f, 7, 10.0, 0.0) for f in range(3, 12)]
    found = values(drive(truth, tracks, 12, detections), "latency_of_detected")
    assert {limit: value for limit, (value, _) in found.items()} == {
        0.0: 0.0, 0.5: 1.0, 1.0: 1.0, 1.5: 1.0, 2.0: 1.0, 3.0: 1.0, 5.0: 1.0,
    }  # fmt: skip
    assert {events for _, events in found.values()} == {1}


def test_false_tracks_by_false_detections() -> None:
    truth = [(f, 1, 0.0, 0.0) for f in range(2)]
    right = [(f, 1, 0.1, 0.0) for f in range(2)]
    clutter = [(1, k, 20.0 + 3 * k, 0.0) for k in range(2, 8)]
    found = values(drive(truth, [*right, *clutter[:3]], 2, [*right, *clutter]), "false_by_clutter")
    assert found == {0.0: (0.0, 1), 5.0: (3.0, 1)}


def test_neighbours_by_their_distance() -> None:
    truth = [(f, i, x, 0.0) for f in range(4) for i, x in ((1, 0.0), (2, 1.5), (3, 40.0))]
    tracks = [(f, 9, 40.0, 0.0) for f in range(4)]
    tracks += [(f, i, x, 0.0) for f in range(2) for i, x in ((7, 0.0), (8, 1.5))]
    tracks += [(f, i, x, 0.0) for f in (2, 3) for i, x in ((17, 0.0), (8, 1.5))]
    found = values(drive(truth, tracks, 4), "neighbour")
    assert found[1.0] == (pytest.approx(5 / 6), 6)
    assert found[10.0] == (1.0, 3)


def test_velocity_errors_and_false_boxes() -> None:
    truth = [(f, 1, 0.0, 4.0) for f in range(3)]
    tracks = [(f, 7, 0.0, v) for f, v in enumerate((0.0, 3.0, 4.0))] + [(1, 8, 50.0, 0.0)]
    found = drive(truth, tracks, 3)
    assert values(found, "velocity_by_age") == {0.0: (4.0, 1), 0.25: (1.0, 1), 0.75: (0.0, 1)}
    assert values(found, "velocity_by_speed") == {3.0: (pytest.approx(5 / 3), 3)}
    assert values(found, "velocity_by_points") == {5.0: (pytest.approx(5 / 3), 3)}
    assert values(found, "false_by_crowd") == {1.0: (pytest.approx(1 / 3), 3)}
    assert values(found, "time_by_load") == {0.0: (pytest.approx(2.0), 3)}


def test_nothing_there_has_no_curve() -> None:
    assert set(drive([(0, 1, 0.0, 0.0)], [], 1)) >= {"latency", "false_by_crowd"}
    assert set(drive([], [(0, 1, 0.0, 0.0)], 1)) == {"false_by_crowd", "time_by_load"}


def test_recorded_output_of_a_published_tracker(shared_data: Path, tmp_path: Path) -> None:
    """KITTI's rule counts no switch after a miss; the curve over gaps does, which is its point."""
    labels = shared_data / "kitti_tracking/training/label_02"
    tracks = shared_data / "kitti_ab3dmot_reference/pointrcnn_Car_val"
    command = ["eval", "capabilities", "--labels", str(labels), "--tracks", str(tracks)]
    done = CliRunner().invoke(app, [*command, "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    found = json.loads((tmp_path / "capabilities.json").read_text())["pointrcnn_Car_val"]
    assert set(found) == {"identity_over_gap", "latency", "neighbour", "false_by_crowd"}
    assert sum(p["events"] for p in found["latency"]) == 190 * 7  # every car of the split
    assert found["neighbour"][-1]["value"] > 0.98
    assert (tmp_path / "capabilities.png").is_file()
    assert set(found) <= set(CAPABILITIES)


def test_nothing_to_evaluate_is_an_error(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["eval", "capabilities", "--out", str(tmp_path)])
    assert isinstance(done.exception, InputError)

"""Labels that were made wrong are found; right ones are not suspected."""

import json
from dataclasses import replace

import pytest
from typer.testing import CliRunner

from mottrack.cli import app
from mottrack.eval.label_errors.suspects import Suspect, suspects
from mottrack.eval.tracked_scenes import TrackedScenes

from .scenes import Box, scenes

FRAMES = range(6)
PLACES = {1: (10.0, 0.0), 2: (20.0, 5.0), 3: (30.0, -5.0)}


def boxes(speed: float = 3.0, **changed: object) -> list[Box]:
    return [
        Box(f, i, x + 0.5 * speed * f, y, speed=speed)._replace(**changed)
        for f in FRAMES
        for i, (x, y) in PLACES.items()
    ]


def found(truth: list[Box], tracked: TrackedScenes | None = None) -> list[Suspect]:
    listed = suspects(tracked or scenes(truth, boxes(), boxes(), labels=("car", "bus")))
    assert not isinstance(listed, str)
    return listed


def test_right_labels_are_not_suspected() -> None:
    assert found(boxes()) == []


def test_a_missing_label_is_found_where_it_was() -> None:
    (one,) = found([b for b in boxes() if b.id != 2])
    assert (one.kind, one.scene, one.track_id, one.frames) == ("missing label", "one", 2, 6)
    assert one.agreed == ("detections", "flow", "tracks")
    assert one.xy_m[1] == 5.0


def test_another_class_and_another_motion_are_told_from_each_other() -> None:
    truth = [
        b._replace(label="bus") if b.id == 1 else b._replace(speed=0.0) if b.id == 3 else b
        for b in boxes()
    ]
    kinds = {one.track_id: (one.kind, one.labelled) for one in found(truth)}
    assert kinds == {1: ("other class", "bus"), 3: ("other motion", "0.0 m/s")}


def test_too_few_frames_weak_detections_and_silent_flow_accuse_nobody() -> None:
    short = [b for b in boxes() if b.id != 2 or b.frame > 1]
    assert found(short) == []
    weak = [b._replace(score=0.1) if b.id == 2 else b for b in boxes()]
    missing = [b for b in boxes() if b.id != 2]
    assert found(missing, scenes(missing, boxes(), weak)) == []
    unmeasured = [b._replace(speed=float("nan")) for b in boxes()]
    (one,) = found(missing, scenes(missing, boxes(), unmeasured))
    assert one.agreed == ("detections", "tracks")
    standing = [b._replace(speed=0.0) for b in boxes()]
    assert found(standing, scenes(standing, boxes(), unmeasured)) == []  # motion needs flow


def test_classes_that_are_alike_do_not_deny_each_other() -> None:
    truth = [b._replace(label="van") if b.id == 1 else b for b in boxes()]
    tracked = scenes(truth, boxes(), boxes())
    assert [one.kind for one in found(truth, tracked)] == ["other class"]
    assert found(truth, replace(tracked, alike={"car": ("van",)})) == []


def test_without_the_trackers_input_nothing_is_said() -> None:
    said = suspects(scenes(boxes(), boxes()))
    assert isinstance(said, str)
    assert "--detections" in said


def test_missing_labels_of_a_recorded_data_set(shared_data, tmp_path) -> None:
    """KITTI's sequence 0001 has rows of parked cars of which some have no label."""
    kitti = shared_data / "kitti_tracking"
    command = ["eval", "label-errors", "--labels", str(kitti / "training/label_02")]
    command += ["--tracks", str(shared_data / "kitti_ab3dmot_reference/pointrcnn_Car_val")]
    command += ["--detections", str(kitti / "detections/pointrcnn"), "--split", "1"]
    done = CliRunner().invoke(app, [*command, "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    listed = json.loads((tmp_path / "label_errors.json").read_text())["pointrcnn_Car_val"]
    assert {one["kind"] for one in listed} == {"missing label"}
    assert listed[0]["frames"] >= 5
    assert listed[0]["speed_mps"] is None  # KITTI's results tell no velocity


@pytest.mark.parametrize("verb", ["slices", "calibration", "label-errors", "report"])
def test_nothing_to_evaluate_is_an_error(verb: str, tmp_path) -> None:
    done = CliRunner().invoke(app, ["eval", verb, "--out", str(tmp_path / "x")])
    assert "nothing to evaluate" in str(done.exception)

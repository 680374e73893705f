"""Tracks of a run as a ROS 2 log, read by the readers of others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs the extra: pip install mottrack[ros]")

from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from mottrack.core import BevGrid, Pose, SceneResult, Snapshot
from mottrack.core.snapshot import ObjectTable
from mottrack.core.tables import FrameTable, TrackTable, TruthTable
from mottrack.datasets.ros.dataset import RosConfig, RosLogs
from mottrack.datasets.ros.write_tracks import FrameNames, write_tracks_mcap

STAMPS = [1_600_000_000_123_456_789, 1_600_000_000_223_456_789]
WORLD_T_EGO = Pose.from_yaw(0.5, (4_000_000.0, 200.0, 30.0))
"""Coordinates as UTM has them."""


@pytest.fixture
def result() -> SceneResult:
    count = 3
    centre_m = WORLD_T_EGO.translation_m + np.array([[10.0, 0, 1], [20, 5, 1], [11, 0, 1]])
    frames = FrameTable(
        np.array(STAMPS),
        np.array(["a", "b"]),
        np.array([WORLD_T_EGO.matrix] * 2),
        np.tile([-np.pi, np.pi], (2, 1)),
        np.zeros(2, bool),
    )
    tracks = TrackTable(
        frame=np.array([0, 0, 1]),
        id=np.array([7, 2**40, 7]),
        label=np.array(["car", "truck", "car"]),
        centre_m=centre_m,
        size_m=np.tile([4.0, 2.0, 1.5], (count, 1)),
        yaw_rad=np.array([0.3, -2.0, 0.3]),
        velocity_mps=np.array([[10.0, 0.0], [0.0, 0.0], [10.0, 0.0]]),
        velocity_covariance_m2ps2=np.tile(np.eye(2), (count, 1, 1)),
        score=np.array([0.9, 0.5, 0.8]),
        observed=np.ones(count, bool),
        hull_corners=np.zeros(count, int),
    )
    return SceneResult("drive", frames, TruthTable.empty(), tracks)


def snapshot() -> Snapshot:
    return Snapshot(
        frame=0,
        xyz_m=np.array([[1.0, 2.0, 3.0]], np.float32),
        grid=BevGrid(),
        cells=np.array([[10, 20], [11, 20]]),
        velocity_mps=np.array([[5.0, 0.0], [1.0, 0.0]], np.float32),
        valid=np.array([True, False]),
        objects=ObjectTable.empty(),
    )


def messages(path: Path) -> dict[str, list[tuple[int, object]]]:
    found: dict[str, list[tuple[int, object]]] = {}
    with AnyReader([path]) as reader:
        for connection, stamp, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((stamp, message))
    return found


def test_boxes_velocities_identities_and_flow_at_the_stamps_of_the_run(result, tmp_path):
    path = tmp_path / "drive.mcap"
    assert write_tracks_mcap(path, result, [snapshot()], FrameNames("odom", "body")) == 3
    found = messages(path)
    counts = {topic: len(rows) for topic, rows in found.items()}
    frames = {"/tf": 2, "/tracks/markers": 2, "/tracks/boxes": 2}
    assert counts == frames | {"/tracks/flow": 1, "/tracks/points": 1}
    assert [stamp for stamp, _ in found["/tracks/markers"]] == STAMPS
    first = found["/tracks/markers"][0][1].markers
    assert {(m.header.stamp.sec, m.header.stamp.nanosec) for m in first} == {
        (1_600_000_000, 123_456_789)
    }
    assert first[0].action == first[0].DELETEALL
    assert len({m.id for m in first}) == len(first)
    boxes = [m for m in first if m.type == m.CUBE]
    assert [(m.pose.position.x, m.scale.x) for m in boxes] == [
        (4_000_010.0, 4.0),
        (4_000_020.0, 4.0),
    ]
    arrows = [m for m in first if m.ns == "velocities"]
    assert len(arrows) == 1  # the truck stands
    assert arrows[0].points[1].x - arrows[0].points[0].x == 10.0
    assert [m.text for m in first if m.ns == "names"] == ["car 7", f"truck {2**40}"]
    flow = found["/tracks/flow"][0][1].markers[1]
    assert (flow.header.frame_id, len(flow.points), len(flow.colors)) == ("body", 2, 2)
    assert flow.points[1].x - flow.points[0].x == 5.0
    moved = found["/tf"][0][1].transforms[0]
    assert (moved.header.frame_id, moved.child_frame_id) == ("odom", "body")


def test_every_schema_is_whole_for_foxglove(result, tmp_path):
    """A viewer knows no types of its own: each schema defines all that it names."""
    path = tmp_path / "drive.mcap"
    write_tracks_mcap(path, result)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        schemas = reader.get_summary().schemas.values()
        assert sum(1 for _ in reader.iter_messages()) == 6
    assert {schema.encoding for schema in schemas} == {"ros2msg"}
    boxes = next(s for s in schemas if s.name == "vision_msgs/msg/Detection3DArray")
    assert b"MSG: vision_msgs/BoundingBox3D\n" in boxes.data


def test_the_boxes_are_read_back(result, tmp_path):
    """By tf of a vehicle that waits, as detections and as labels with their identities."""
    write_tracks_mcap(tmp_path / "drive.mcap", result)
    boxes = {"detections_topic": "/tracks/boxes", "truth_topic": "/tracks/boxes"}
    scene = RosLogs(RosConfig(root=tmp_path, points_topic=(), **boxes)).scene("drive")
    frame, tracks = scene.frame(0), result.tracks.select(result.tracks.frame == 0)
    for read in (frame.detections, frame.truth):
        np.testing.assert_allclose(read.centre_m, tracks.centre_m, atol=1e-6)
        np.testing.assert_allclose(read.yaw_rad, tracks.yaw_rad, atol=1e-9)
        assert read.label.tolist() == ["car", "truck"]
    assert frame.truth.id.tolist() == tracks.id.tolist()
    assert frame.detections.score.tolist() == [0.9, 0.5]

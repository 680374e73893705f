"""Boxes are matched to a fast ball where the LiDAR scanned it: behind its place at the stamp."""

from dataclasses import replace

import numpy as np
import pytest

from mottrack.core.result import SceneResult
from mottrack.core.snapshot import ObjectTable, Snapshot
from mottrack.core.tables import FrameTable, TrackTable, TruthTable
from mottrack.paper.ball_figure import clustered, draw_ball, tracked
from mottrack.runs.run_folder import StoredScene

FRAMES = 8
SPEED_MPS = 6.0
SEEN_M = -0.4
"""Where the ball was scanned along its path, relative to its place at the stamp."""


def ball_xy_m() -> np.ndarray:
    return np.column_stack([0.1 * SPEED_MPS * np.arange(FRAMES), np.full(FRAMES, 2.0)])


def truth(label: str) -> TruthTable:
    return TruthTable(
        frame=np.arange(FRAMES),
        id=np.full(FRAMES, 7),
        label=np.full(FRAMES, label),
        centre_m=np.insert(ball_xy_m(), 2, 0.6, axis=1),
        size_m=np.full((FRAMES, 3), 0.3),
        yaw_rad=np.full(FRAMES, 1.2),  # a ball may spin
        velocity_mps=np.tile([SPEED_MPS, 0.0], (FRAMES, 1)),
        num_points=np.full(FRAMES, 9),
        interpolated=np.zeros(FRAMES, np.bool_),
    )


def tracks(beside_m: float, size_m: float) -> TrackTable:
    centre_m = np.insert(ball_xy_m() + np.array([beside_m, 0.0]), 2, 0.6, axis=1)
    return TrackTable(
        frame=np.arange(FRAMES),
        id=np.arange(FRAMES) // 4,
        label=np.full(FRAMES, "generic"),
        centre_m=centre_m,
        size_m=np.full((FRAMES, 3), size_m),
        yaw_rad=np.zeros(FRAMES),
        velocity_mps=np.tile([5.0, 0.0], (FRAMES, 1)),
        velocity_covariance_m2ps2=np.tile(np.eye(2), (FRAMES, 1, 1)),
        score=np.ones(FRAMES),
        observed=np.arange(FRAMES) > 0,
        hull_corners=np.zeros(FRAMES, np.int64),
    )


def scene(
    found: TrackTable, snapshots: list[Snapshot] | None = None, label: str = "ball"
) -> StoredScene:
    frames = FrameTable(
        stamp_ns=np.arange(FRAMES) * 100_000_000,
        token=np.arange(FRAMES).astype(np.str_),
        world_T_ego=np.tile(np.eye(4), (FRAMES, 1, 1)),
        labelled_azimuth_rad=np.tile([-np.pi, np.pi], (FRAMES, 1)),
        annotated=np.ones(FRAMES, np.bool_),
    )
    result = SceneResult("one", frames, truth(label), found, classes=("car",))
    return StoredScene(result, snapshots or [])


def test_the_observed_rows_on_its_path_are_the_ball() -> None:
    found = tracked(scene(tracks(SEEN_M, 0.25)), truth("ball"))
    assert found.frame.tolist() == list(range(1, FRAMES))  # row 0 was not observed
    np.testing.assert_allclose(found.velocity_mps, [[5.0, 0.0]] * (FRAMES - 1))
    np.testing.assert_allclose(found.true_mps, [[SPEED_MPS, 0.0]] * (FRAMES - 1))


@pytest.mark.parametrize(("beside_m", "size_m"), [(0.5, 0.25), (-1.2, 0.25), (SEEN_M, 2.0)])
def test_boxes_beside_its_path_or_larger_are_not(beside_m: float, size_m: float) -> None:
    stored = scene(tracks(beside_m, size_m))
    assert not len(tracked(stored, truth("ball")).frame)
    assert draw_ball({"without flow": stored, "with flow": stored}) is None


def test_other_labels_are_no_ball() -> None:
    stored = scene(tracks(SEEN_M, 0.25), label="animal")
    assert draw_ball({"without flow": stored, "with flow": stored}) is None


def snapshot(frame: int, speed_mps: float) -> Snapshot:
    table = tracks(SEEN_M, 0.25)
    row = table.select(table.frame == frame)
    objects = ObjectTable(
        label=row.label,
        centre_m=row.centre_m,
        size_m=row.size_m,
        yaw_rad=row.yaw_rad,
        score=row.score,
        velocity_mps=np.array([[speed_mps, 0.0]]),
    )
    shot = Snapshot.of(frame, np.zeros((0, 3), np.float32), None, None)
    return replace(shot, objects=objects)


def test_the_description_has_the_errors_of_tracks_and_flow() -> None:
    shots = [snapshot(2, np.nan), snapshot(3, 2.0)]
    without, with_flow = scene(tracks(SEEN_M, 0.25)), scene(tracks(SEEN_M, 0.25), shots)
    found = clustered(with_flow, truth("ball"))
    np.testing.assert_array_equal(found.velocity_mps[:, 0], [np.nan, 2.0])
    figure, told = draw_ball({"without flow": without, "with flow": with_flow})
    assert "ball of 0.3 m at 6.0 m/s" in told
    assert "without flow 1.00, tracked with flow 1.00, measured by the flow 4.00" in told
    assert len(figure.axes) == 2

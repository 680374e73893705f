from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mottrack.core import (
    BevGrid,
    FlowField,
    Frame,
    InputError,
    Objects,
    Pose,
    ResultError,
    SceneResult,
    Sweep,
    Tracks,
    Truth,
    VelocityMeasurement,
)
from mottrack.core.tables import FrameTable, TrackTable, TruthTable


def some_objects(n: int = 3, seed: int = 0) -> Objects:
    rng = np.random.default_rng(seed)
    return Objects(
        stamp_ns=10**9,
        centre_m=rng.normal(size=(n, 3)) * 20,
        size_m=rng.uniform(0.5, 5, size=(n, 3)),
        yaw_rad=rng.uniform(-3, 3, size=n),
        label=np.array(["car", "pedestrian", "truck"])[:n],
        score=rng.uniform(size=n),
        velocity=VelocityMeasurement(
            rng.normal(size=(n, 2)), np.tile(np.diag([1.0, 4.0]), (n, 1, 1)), np.ones(n, bool)
        ),
        hull=tuple(rng.normal(size=(4, 2)) for _ in range(n)),
    )


def some_tracks(n: int = 2) -> Tracks:
    o = some_objects(n)
    return Tracks(
        stamp_ns=o.stamp_ns,
        centre_m=o.centre_m,
        size_m=o.size_m,
        yaw_rad=o.yaw_rad,
        label=o.label,
        id=np.arange(n),
        score=o.score,
        velocity_mps=np.ones((n, 2)),
        velocity_covariance_m2ps2=np.tile(np.eye(2), (n, 1, 1)),
        state=np.ones((n, 4)),
        covariance=np.tile(np.eye(4), (n, 1, 1)),
        observed=np.ones(n, bool),
        hull=o.hull,
    )


@given(st.integers(0, 200))
def test_boxes_survive_a_round_trip_through_another_frame(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = Pose.from_quaternion_wxyz(
        _unit(rng.normal(size=4) * [1, 0.05, 0.05, 1]), rng.normal(size=3)
    )
    before = some_objects(seed=seed)
    after = before.transformed(pose, "ego").transformed(pose.inverse(), "world")
    np.testing.assert_allclose(after.centre_m, before.centre_m, atol=1e-9)
    np.testing.assert_allclose(np.cos(after.yaw_rad - before.yaw_rad), 1, atol=1e-12)
    assert after.velocity is not None
    assert before.velocity is not None
    np.testing.assert_allclose(after.velocity.mean_mps, before.velocity.mean_mps, atol=1e-12)
    np.testing.assert_allclose(
        after.velocity.covariance_m2ps2, before.velocity.covariance_m2ps2, atol=1e-12
    )


def _unit(q: np.ndarray) -> np.ndarray:
    return q / np.linalg.norm(q)


def test_select_takes_every_column_along() -> None:
    picked = some_objects().select(np.array([2, 0]))
    assert picked.label.tolist() == ["truck", "car"]
    assert picked.velocity is not None
    assert picked.hull is not None
    assert len(picked.velocity) == len(picked.hull) == 2


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"size_m": np.zeros((3, 3))}, r"size_m\[0, 0\] is 0.0, expected a positive"),
        ({"yaw_rad": np.array([0, np.nan, 0])}, r"yaw_rad\[1\] is nan"),
        ({"score": np.zeros(2)}, r"shape of score is \(2,\), expected \(3\)"),
        ({"frame": "map"}, "frame is 'map', expected one of world, ego"),
        ({"stamp_ns": 1.5}, "stamp_ns is 1.5, expected an integer"),
        ({"velocity": VelocityMeasurement.absent(2)}, "length of velocity is 2"),
        ({"velocity": np.zeros((3, 2))}, "velocity is of type ndarray, expected a Velocity"),
        ({"centre_m": None}, r"shape of centre_m is \(\), expected \(N, 3\)"),
        (
            {"centre_m": [[1, 2, 3], [4]]},
            "centre_m is rows of unequal length, expected an array of float64",
        ),
        ({"label": ["car", None, "car"]}, r"label\[1\] is None, expected text"),
        ({"num_points": [4, 1.5, 2]}, r"num_points\[1\] is 1.5, expected a whole number"),
        ({"num_points": [4, np.nan, 2]}, r"num_points\[1\] is nan, expected a whole number"),
        ({"hull": (np.eye(2), np.full((3, 2), np.inf), np.eye(2))}, r"hull\[1\]\[0, 0\] is inf"),
    ],
)
def test_unusable_objects_are_refused_by_the_name_of_the_field(
    change: dict[str, object], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        replace(some_objects(), **change)


def test_an_identity_occurs_once_at_a_stamp() -> None:
    with pytest.raises(InputError, match="id is 7 for 2 tracks, expected no identity twice"):
        replace(some_tracks(3), id=np.array([1, 7, 7]))


def test_a_frame_and_a_sweep_require_a_pose_and_ascending_azimuths() -> None:
    matrix = np.eye(4)
    with pytest.raises(InputError, match="world_T_ego is of type ndarray, expected a Pose"):
        Frame(0, matrix)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="world_T_ego is of type ndarray"):
        Sweep(np.zeros((1, 3)), np.zeros(1), 0, matrix)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"labelled_azimuth_rad is \[2.5, -2.5\]"):
        Frame(0, Pose.identity(), labelled_azimuth_rad=(2.5, -2.5))


def test_the_frames_of_a_scene_are_in_order_of_time() -> None:
    frames = [Frame(stamp, Pose.identity()) for stamp in (5, 9, 9)]
    with pytest.raises(InputError, match=r"stamp_ns\[2\] is 9, expected later"):
        FrameTable.of(frames)


def test_a_velocity_with_a_negative_variance_is_refused_unless_masked() -> None:
    bad = np.array([[[-1.0, 0], [0, 1]]])
    with pytest.raises(InputError, match="positive semi-definite"):
        VelocityMeasurement(np.zeros((1, 2)), bad, np.ones(1, bool))
    masked = VelocityMeasurement(np.full((1, 2), np.nan), bad, np.zeros(1, bool))
    assert masked.mean_mps.tolist() == [[0.0, 0.0]]


def test_checked_arrays_are_read_only() -> None:
    with pytest.raises(ValueError, match="read-only"):
        some_objects().centre_m[0] = np.nan


@given(st.floats(-60, 60), st.floats(-60, 60))
def test_a_position_lies_in_the_cell_whose_centre_is_nearest(x_m: float, y_m: float) -> None:
    grid = BevGrid(-50, 50, -25, 25, 0.5)
    row, column, inside = grid.cells(np.array([[x_m, y_m]]))
    if not inside[0]:
        assert not (-50 <= x_m < 50 and -25 <= y_m < 25)
        return
    centre = grid.centres_m()[row[0], column[0]]
    assert np.abs(centre - [x_m, y_m]).max() <= 0.25 + 1e-9


def test_the_default_grid_is_the_papers_and_odd_extents_are_refused() -> None:
    assert BevGrid().shape == (400, 400)
    with pytest.raises(InputError, match="whole number of cells"):
        BevGrid(cell_m=0.3)


def test_a_field_of_another_shape_than_its_grid_or_with_wrong_weights_is_refused() -> None:
    field = FlowField.empty(BevGrid(), 0)
    with pytest.raises(InputError, match="shape of velocity_mps"):
        replace(field, velocity_mps=np.zeros((2, 2, 2)))
    with pytest.raises(InputError, match=r"range of weight is \[-2.0, -2.0\]"):
        replace(field, weight=np.full((400, 400), -2.0))


def test_a_sweep_refuses_nan_and_keeps_its_rays_when_moved() -> None:
    sweep = Sweep(
        np.ones((2, 3)), np.zeros(2), 0, Pose.from_yaw(0.3, (5, 0, 0)), np.array([0, 0, 2.0])
    )
    with pytest.raises(InputError, match=r"xyz_m\[1, 2\] is nan"):
        replace(sweep, xyz_m=np.array([[0, 0, 0], [0, 0, np.nan]]))
    other = replace(sweep, world_T_ego=Pose.from_yaw(-0.2, (1, 1, 0)))
    moved = sweep.seen_from(other)
    ray = np.linalg.norm(sweep.xyz_m - sweep.origin_m, axis=1)
    np.testing.assert_allclose(np.linalg.norm(moved.xyz_m - moved.origin_m, axis=1), ray, atol=1e-5)


def some_result() -> SceneResult:
    truth = Truth(
        stamp_ns=0,
        centre_m=np.zeros((1, 3)),
        size_m=np.ones((1, 3)),
        yaw_rad=np.zeros(1),
        label=np.array(["car"]),
        id=np.zeros(1, np.int64),
        velocity_mps=np.zeros((1, 2)),
        num_points=np.array([4]),
        interpolated=np.zeros(1, bool),
    )
    frames = [Frame(k * 10**8, Pose.identity(), truth=truth, token=f"t{k}") for k in range(2)]
    steps = [some_tracks(), some_tracks(1)]
    hulls = np.concatenate([h for step in steps for h in step.hull or ()])
    return SceneResult(
        "scene", FrameTable.of(frames), TruthTable.of(frames), TrackTable.of(steps), hull_xy_m=hulls
    )


def test_a_result_is_stored_byte_identically_and_read_back(tmp_path: Path) -> None:
    result = some_result()
    result.save(tmp_path / "a.npz")
    result.save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    back = SceneResult.load(tmp_path / "a.npz")
    assert back.tracks.label.tolist() == ["car", "pedestrian", "car"]
    assert [len(h) for h in back.hulls] == [4, 4, 4]
    assert back.frames.token.tolist() == ["t0", "t1"]


def test_any_damage_to_a_stored_result_is_detected(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    some_result().save(path)
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    for _ in range(100):
        data = bytearray(whole)
        data[rng.integers(len(data))] ^= 1 << rng.integers(8)
        path.write_bytes(bytes(data))
        with pytest.raises(ResultError, match=r"a\.npz: checksum"):
            SceneResult.load(path)
    for cut in range(0, len(whole), len(whole) // 100):
        path.write_bytes(whole[:cut])
        with pytest.raises(ResultError, match=r"a\.npz"):
            SceneResult.load(path)


def test_boxes_outside_the_labelled_azimuth_do_not_count() -> None:
    n = 4
    tracks = replace(
        some_tracks(3),
        centre_m=np.array([[10.0, 0, 0], [-10, 0, 0], [0, 10, 0]]),
        label=np.array(["car"] * 3),
    )
    turned = Pose.from_yaw(np.pi / 2)  # the vehicle looks along +y of the world
    frames = [
        Frame(k, turned, truth=Truth.empty(k), labelled_azimuth_rad=(-0.5, 0.5)) for k in range(n)
    ]
    table = TrackTable.of([tracks])
    hulls = np.concatenate(tracks.hull or ())
    result = SceneResult(
        "s", FrameTable.of(frames), TruthTable.empty(), table, hull_xy_m=hulls
    ).where_labelled()
    assert result.tracks.centre_m.tolist() == [[0, 10, 0]]
    np.testing.assert_array_equal(result.hulls[0], (tracks.hull or ())[2])


def test_tracks_of_frames_without_annotation_are_no_errors() -> None:
    pose = Pose.from_yaw(0.0)
    frames = [Frame(0, pose, truth=Truth.empty(0)), Frame(1, pose, truth=None)]
    steps = [replace(some_tracks(2), stamp_ns=k) for k in range(2)]
    hulls = np.concatenate([hull for step in steps for hull in step.hull or ()])
    result = SceneResult(
        "s", FrameTable.of(frames), TruthTable.empty(), TrackTable.of(steps), hull_xy_m=hulls
    )
    assert result.where_labelled().tracks.frame.tolist() == [0, 0]

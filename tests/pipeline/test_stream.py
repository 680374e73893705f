"""The streaming pipeline returns the same tracks as the batch run, to the last bit."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

import mottrack
from mottrack import Pipeline, Pose, VelocityMeasurement
from mottrack.core import ConfigError, Frame, InputError, Sweep, TrackTable
from mottrack.core.velocity_errors import FLOW_ERRORS, NO_OUTLIERS
from mottrack.experiment.experiment import load_to_stream
from mottrack.pipeline.scene_run import run_scene
from mottrack.pipeline.stream import joined

WORLD = ("dataset.scenes=1", "dataset.seed=5", "dataset.duration_s=1.2", "dataset.key_hz=5")
DETECTED = [
    "flow=zero",
    "flow=ground_truth",
    "flow=icp_one_start",
    "flow=cluster_icp",
    "flow=dogma",
]
Drive = list[tuple[Frame, Sweep]]


def overrides(*chosen: str) -> list[str]:
    light = ["flow.filter.particles=20000", "flow.filter.births=2000"]
    return [*WORLD, "score_flow=false", *chosen, *(light if "flow=dogma" in chosen else [])]


@pytest.fixture(scope="module")
def drive() -> Drive:
    scene = the_scene()
    return [(scene.frame(k), scene.sweep(k)) for k in range(len(scene))]


def the_scene():
    dataset = load_to_stream("demo", overrides("flow=zero")).dataset.make()
    return dataset.scene(dataset.scene_names[0])


def columns(table: TrackTable) -> dict[str, np.ndarray]:
    return {name: getattr(table, name) for name in table.COLUMNS}


@pytest.mark.parametrize(
    "chosen",
    [
        *[(flow, "tracker=kalman") for flow in DETECTED],
        ("flow=zero", "tracker=kalman", "tracker.smooth=true"),
        ("flow=cluster_icp", "objects=clusters", "tracker=fixed_lag"),
    ],
    ids=" ".join,
)
def test_streamed_tracks_equal_those_of_the_batch_run(chosen: tuple[str, ...], drive) -> None:
    experiment = load_to_stream("demo", overrides(*chosen))
    expected = run_scene(experiment, the_scene()).result
    pipeline = Pipeline(experiment)
    steps = [pipeline.step(frame, sweep).tracks for frame, sweep in drive]
    streamed = pipeline.finish([tracks for tracks in steps if tracks is not None])
    assert len(expected.tracks) > 20
    for name, column in columns(TrackTable.of(streamed)).items():
        np.testing.assert_array_equal(column, getattr(expected.tracks, name), err_msg=name)
    hulls = [hull for tracks in streamed for hull in tracks.hull or ()]
    assert len(hulls) == len([h for h in expected.hulls if len(h)])


def test_plain_arrays_give_the_same_tracks_as_the_core_types(drive: Drive) -> None:
    ours, plain = (Pipeline.from_config("demo", "flow=icp_one_start") for _ in range(2))
    names = ("frame", "centre_m", "size_m", "yaw_rad", "label", "score")
    for frame, sweep in drive:
        found = frame.detections
        fed = plain.feed(
            frame.stamp_ns,
            np.column_stack([sweep.xyz_m, sweep.reflectance]),
            frame.world_T_ego.matrix,
            {name: getattr(found, name) for name in names},
            sweep.origin_m,
        )
        expected = ours.step(Frame(frame.stamp_ns, frame.world_T_ego, found), sweep)
        for name in TrackTable.COLUMNS:
            got, wanted = (getattr(TrackTable.of([s.tracks]), name) for s in (fed, expected))
            np.testing.assert_array_equal(got, wanted, err_msg=name)
    assert len(fed.tracks) > 5


def test_a_reused_buffer_does_not_change_earlier_input(drive: Drive) -> None:
    fresh, reused = (Pipeline.from_config("demo", "flow=icp_one_start") for _ in range(2))
    points, pose = np.zeros((200_000, 3), np.float32), np.zeros((4, 4))
    for frame, sweep in drive[:4]:
        n = len(sweep)
        points[:n], pose[:] = sweep.xyz_m, frame.world_T_ego.matrix
        expected = fresh.feed(frame.stamp_ns, sweep.xyz_m, frame.world_T_ego, frame.detections)
        got = reused.feed(frame.stamp_ns, points[:n], pose, frame.detections)
    assert got.field is not None
    assert expected.field is not None
    assert got.field.valid.any()
    np.testing.assert_array_equal(got.field.velocity_mps, expected.field.velocity_mps)


def test_detections_in_the_ego_frame_are_transformed_to_the_world() -> None:
    pipeline = Pipeline.from_config("demo", "flow=zero", "tracker=stanford_iprl_tri")
    pose = Pose.from_yaw(np.pi / 2, (100.0, 0.0, 0.0))
    tracks = pipeline.feed(10**9, None, pose, ahead(10.0)).tracks
    np.testing.assert_allclose(tracks.centre_m, [[100.0, 10.0, 0.8]], atol=1e-9)
    np.testing.assert_allclose(tracks.yaw_rad, [np.pi / 2])


def ahead(x_m: float, **changes: object) -> dict[str, object]:
    return {
        "frame": "ego",
        "centre_m": [[x_m, 0.0, 0.8]],
        "size_m": [[4.5, 1.9, 1.6]],
        "yaw_rad": [0.0],
        "label": ["car"],
        "score": [0.9],
    } | changes


RADAR = VelocityMeasurement(np.array([[5.0, 1.0]]), np.array([0.04 * np.eye(2)]), np.array([True]))


def test_a_velocity_that_comes_with_a_detection_reaches_the_tracker_beside_the_flow() -> None:
    pipeline = Pipeline.from_config("demo", "flow=zero")
    points = np.random.default_rng(0).uniform(-30, 30, (2000, 3))
    for k in range(2):  # at the second step there is a pair of sweeps, and a field
        found = ahead(10.0 + 0.5 * k, velocity=RADAR)
        step = pipeline.feed(k * 10**8, points, np.eye(4), found)
    assert step.field is not None
    np.testing.assert_allclose(step.objects.velocity.mean_mps, RADAR.mean_mps)


def test_velocities_of_two_sources_are_fused_and_one_alone_keeps_its_error_model() -> None:
    flow = RADAR.with_error_model(FLOW_ERRORS)
    both = joined(RADAR, flow)
    np.testing.assert_allclose(both.covariance_m2ps2, RADAR.covariance_m2ps2 / 2)
    assert both.error_model == NO_OUTLIERS
    nothing = VelocityMeasurement.absent(1)
    assert joined(None, flow) is joined(nothing, flow) is flow
    assert joined(RADAR, nothing.with_error_model(FLOW_ERRORS)) is RADAR
    first, second = (
        VelocityMeasurement(
            np.repeat(RADAR.mean_mps, 2, axis=0),
            np.repeat(RADAR.covariance_m2ps2, 2, axis=0),
            np.array(valid),
            error_model,
        )
        for valid, error_model in (([True, False], NO_OUTLIERS), ([True, True], FLOW_ERRORS))
    )
    assert joined(first, second).error_model == FLOW_ERRORS


@pytest.mark.parametrize("flow", ["zero", "icp_one_start", "dogma"])
def test_a_late_or_repeated_stamp_changes_nothing(flow: str, drive: Drive) -> None:
    experiment = load_to_stream("demo", overrides(f"flow={flow}"))
    clean, disturbed = Pipeline(experiment), Pipeline(experiment)
    (late, late_sweep), *_ = drive
    for frame, sweep in drive:
        expected, got = clean.step(frame, sweep), disturbed.step(frame, sweep)
        if expected.tracks is not None:
            np.testing.assert_array_equal(got.tracks.state, expected.tracks.state)
        for old, old_sweep in ((frame, sweep), (late, late_sweep)):
            with pytest.raises(InputError, match=r"stamp_ns is .*, expected later than"):
                disturbed.step(old, old_sweep)
    assert disturbed.latency().steps == clean.latency().steps


def test_after_a_reset_the_same_drive_gives_the_same_tracks(drive: Drive) -> None:
    pipeline = Pipeline(load_to_stream("demo", overrides("flow=dogma")))
    first = [pipeline.step(*moment).tracks for moment in drive if moment[0].is_key]
    pipeline.reset()
    again = [pipeline.step(*moment).tracks for moment in drive if moment[0].is_key]
    assert len(first[-1]) > 5
    np.testing.assert_array_equal(first[-1].state, again[-1].state)
    np.testing.assert_array_equal(first[-1].id, again[-1].id)


@pytest.mark.parametrize(
    ("points", "detections", "words"),
    [
        (np.zeros((5, 2)), None, r"shape of points is \(5, 2\), expected \(N, 3\) or \(N, 4\)"),
        ([[0, 0, 0, 255.0]], None, r"range of reflectance is \[255.0, 255.0\], expected within"),
        ([[0, 0, np.nan]], None, "xyz_m"),
        (None, {"frame": "ego", "centre_m": [[0, 0, 0]]}, "without size_m, yaw_rad, label, score"),
        (None, ahead(1.0, size_m=[[0.0, 1, 1]]), "size_m"),
        (None, ahead(1.0, frame="car"), "frame is 'car', expected one of world, ego"),
    ],
)
def test_unusable_arrays_are_named_and_the_next_step_works(
    points: object, detections: object, words: str
) -> None:
    pipeline = Pipeline.from_config("demo", "flow=icp")
    with pytest.raises(InputError, match=words):
        pipeline.feed(1, points, np.eye(4), detections)
    assert len(pipeline.feed(1, None, np.eye(4), ahead(9.0)).objects) == 1


def test_an_unknown_array_names_the_nearest() -> None:
    with pytest.raises(ConfigError, match=r"unknown array of detections 'centre' .*'centre_m'"):
        Pipeline.from_config("demo", "flow=zero").feed(1, None, np.eye(4), ahead(1.0, centre=1))


def test_several_variants_are_refused_by_name() -> None:
    with pytest.raises(ConfigError, match=r"4 variants .*expected one: choose"):
        Pipeline.from_config("demo")


def test_the_data_set_of_a_configuration_is_not_needed() -> None:
    pipeline = Pipeline.from_config("kitti_flow_sources", "flow=zero")
    assert not pipeline.needs_sweeps


def test_importing_the_package_does_not_import_the_pipeline() -> None:
    code = "import sys, mottrack; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    heavy = {"scipy", "numba", "torch", "gtsam", "pydantic", "yaml", "mottrack.pipeline"}
    assert not heavy & set(run.stdout.split())
    with pytest.raises(AttributeError, match="Pipelin"):
        mottrack.Pipelin  # noqa: B018


def test_clusters_use_the_ground_of_a_map() -> None:
    from toy_plugins import ToyScene

    asked: list[int] = []

    class MappedScene(ToyScene):
        def ground_height(self, xy_m: np.ndarray) -> np.ndarray:
            asked.append(len(xy_m))
            return np.zeros(len(xy_m))

    experiment = load_to_stream("demo", ["flow=zero", "objects=clusters", "score_flow=false"])
    run_scene(experiment, MappedScene("a", 2, None), keep_snapshots=False)
    assert len(asked) == 2

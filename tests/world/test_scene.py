from __future__ import annotations

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest
from pydantic import ValidationError

from mottrack.core.errors import ConfigError, InputError
from mottrack.core.interfaces import Dataset, Scene
from mottrack.core.sweep import seconds_between
from mottrack.datasets.synthetic import SyntheticConfig, SyntheticDataset
from mottrack.world import TrainingConfig, training_pair
from mottrack.world.catalogue import TRACKED, UNKNOWN
from mottrack.world.ego import pose_of


def digest(scene, index: int) -> str:
    frame, sweep, truth = scene.frame(index), scene.sweep(index), scene.sweep_truth(index)
    parts = [sweep.xyz_m, sweep.reflectance, sweep.world_T_ego.matrix, truth.object_id]
    parts += [truth.velocity_mps, frame.truth.centre_m, frame.detections.centre_m]
    parts += [frame.detections.score, frame.detections.label]
    return hashlib.sha256(b"".join(np.ascontiguousarray(p).tobytes() for p in parts)).hexdigest()


def config(**changes) -> SyntheticConfig:
    return SyntheticConfig(**({"scenes": 3, "seed": 4, "duration_s": 1.5} | changes))


def test_same_bytes_in_any_order_number_of_scenes_and_process():
    few = SyntheticDataset(config())
    name = few.scene_names[2]
    forward = few.scene(name)
    expected = [digest(forward, i) for i in (0, 4, 9)]
    many = SyntheticDataset(config(scenes=9, first_scene=1)).scene(name)
    assert [digest(many, i) for i in (9, 0, 4)] == [expected[2], expected[0], expected[1]]
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]);"
        "from tests.world.test_scene import digest, config;"
        "from mottrack.datasets.synthetic import SyntheticDataset;"
        f"print(digest(SyntheticDataset(config()).scene('{name}'), 4))"
    )
    root = __file__.rsplit("/tests/", 1)[0]
    run = subprocess.run(
        [sys.executable, "-c", code, root],
        capture_output=True,
        text=True,
        check=True,
        cwd=root,
        env=os.environ | {"OMP_NUM_THREADS": "3", "PYTHONHASHSEED": "7"},
    )
    assert run.stdout.strip() == expected[1]


def test_scenes_differ_from_each_other_and_from_other_seeds():
    first = SyntheticDataset(config())
    other = SyntheticDataset(config(seed=5))
    digests = {digest(first.scene(n), 0) for n in first.scene_names}
    digests.add(digest(other.scene(other.scene_names[0]), 0))
    assert len(digests) == 4


def test_it_is_a_dataset_of_scenes(scenes):
    dataset = SyntheticDataset(config())
    assert isinstance(dataset, Dataset)
    assert isinstance(scenes[0], Scene)
    assert dataset.scene_names == (
        "synthetic-s0004-0000",
        "synthetic-s0004-0001",
        "synthetic-s0004-0002",
    )
    keys = [scenes[0].frame(i).is_key for i in range(11)]
    assert keys == [True, False, False, False, False] * 2 + [True]


def test_frame_and_sweep_share_stamp_and_pose(scenes):
    for scene in scenes:
        frame, sweep = scene.frame(7), scene.sweep(7)
        assert frame.stamp_ns == sweep.stamp_ns == 700_000_000
        assert np.array_equal(frame.world_T_ego.matrix, sweep.world_T_ego.matrix)
        assert set(frame.truth.label) <= set(scene.classes) | set(UNKNOWN)
        assert set(frame.detections.label) <= set(TRACKED)
        assert frame.detections.velocity is None


def test_boxes_contain_the_points_of_their_objects_and_count_them(scenes):
    for scene in scenes:
        sweep, point_truth = scene.sweep(20), scene.sweep_truth(20)
        true_pose = pose_of(scene.scan(20).posture)
        truth = scene.frame(20).truth.transformed(true_pose.inverse(), "ego")
        assert (truth.num_points > 20).sum() >= 3
        for row in range(len(truth)):
            points = sweep.xyz_m[point_truth.object_id == truth.id[row]]
            assert len(points) == truth.num_points[row]
            if len(points) < 5:
                continue
            c, s = np.cos(truth.yaw_rad[row]), np.sin(truth.yaw_rad[row])
            local = (points - truth.centre_m[row]) @ [[c, -s, 0], [s, c, 0], [0, 0, 1]]
            # a rolling scan sees agents up to a revolution earlier; split beams end in between
            slack = 0.3 + 0.1 * np.hypot(*truth.velocity_mps[row])
            inside = (np.abs(local) < truth.size_m[row] / 2 + slack).all(axis=1)
            assert inside.mean() > 0.9


def test_static_background_stays_put_in_the_world(scenes):
    """What stands at a place stands there a sweep later: the facades of both sweeps agree."""
    from scipy.spatial import cKDTree

    for scene in scenes[:2]:
        clouds = []
        for index in (10, 13):
            sweep, truth = scene.sweep(index), scene.sweep_truth(index)
            still = (truth.object_id == -1) & ~truth.is_ground
            near = np.hypot(*sweep.xyz_m[:, :2].T) < 25
            clouds.append(pose_of(scene.scan(index).posture).apply(sweep.xyz_m[still & near]))
        gap, _ = cKDTree(clouds[0]).query(clouds[1])
        assert np.median(gap) < 0.2


def test_velocity_of_points_is_that_of_their_boxes(scenes):
    for scene in scenes:
        frame, truth = scene.frame(15), scene.sweep_truth(15)
        boxes = frame.truth.transformed(frame.world_T_ego.inverse(), "ego")
        for row in np.flatnonzero(boxes.num_points > 15):
            mean = truth.velocity_mps[truth.object_id == boxes.id[row]].mean(axis=0)
            # points lie off the middle, so the yaw rate adds to it; so does odometry's heading
            assert np.allclose(
                mean, boxes.velocity_mps[row], atol=0.35 + 0.02 * np.linalg.norm(mean)
            )
        assert (truth.velocity_mps[truth.object_id == -1] == 0).all()


def test_rolling_scan_fires_over_the_whole_revolution_and_flash_at_once():
    rolling = SyntheticDataset(config(scenes=1)).scene("synthetic-s0004-0000").sweep(3)
    flash = SyntheticDataset(config(scenes=1, rolling=False)).scene("synthetic-s0004-0000").sweep(3)
    assert rolling.time_offset_ns.min() < -95_000_000
    assert rolling.time_offset_ns.max() <= 0
    assert (flash.time_offset_ns == 0).all()


def test_agents_keep_within_what_their_kind_can_do(scenes):
    fastest = {"pedestrian": 3.5, "bicycle": 10.0, "animal": 6.0, "ball": 12.0, "debris": 5.0}
    for scene in scenes:
        world = scene.world
        for time_s in np.arange(0.0, 4.0, 0.25):
            states = world.states(time_s)
            speed = np.hypot(states.velocity_mps[:, 0], states.velocity_mps[:, 1])
            bound = np.array([fastest.get(str(name), 48.0) for name in world.label])
            assert (speed <= bound).all()
            push = np.hypot(*states.acceleration_mps2[:, :2].T)
            assert (push < 9.0).all()
            vehicles = np.isin(world.label, ["car", "bus", "truck", "trailer"])
            assert (np.abs(states.yaw_rate_radps[vehicles]) < 1.0).all()


def test_positions_follow_velocities(scenes):
    """The velocity in the truth is the derivative of the position, for every agent."""
    step = 1e-4
    for scene in scenes:
        for time_s in (0.73, 2.251):
            a, b = scene.world.states(time_s), scene.world.states(time_s + step)
            middle = scene.world.states(time_s + step / 2)
            assert np.allclose((b.xy_m - a.xy_m) / step, middle.velocity_mps[:, :2], atol=0.03)


def test_unknown_objects_are_in_the_truth_but_never_detected():
    dense = config(scenes=2, density={"unknown": 8.0})
    found = set()
    for name in SyntheticDataset(dense).scene_names:
        frame = SyntheticDataset(dense).scene(name).frame(2)
        found |= set(frame.truth.label) & set(UNKNOWN)
        assert not set(frame.detections.label) & set(UNKNOWN)
    assert found


def test_objects_are_hidden_and_seen_again(scenes):
    counts = np.zeros((40, len(scenes[0].world.label)), dtype=int)
    for index in range(40):
        counts[index] = scenes[0].scan(index).count
    seen = counts > 0
    hidden_between = [
        (~seen[:, j])[np.argmax(seen[:, j]) : 40 - np.argmax(seen[::-1, j])].any()
        for j in np.flatnonzero(seen.any(axis=0))
    ]
    assert sum(hidden_between) >= 3


def test_training_pairs_are_deterministic_and_varied():
    first, again, other = training_pair(3, 5), training_pair(3, 5), training_pair(3, 6)
    assert np.array_equal(first.current.xyz_m, again.current.xyz_m)
    assert np.array_equal(first.current_truth.velocity_mps, again.current_truth.velocity_mps)
    assert len(other.current) != len(first.current)
    elapsed = first.current.stamp_ns - first.previous.stamp_ns
    assert elapsed == 100_000_000
    assert first.current.ring.max() >= 25


def test_training_pairs_with_older_sweeps_of_turning_and_fast_drives_of_worn_sensors():
    """Every object lies in each older sweep where its track says; the rings are fewer."""
    older = {"older_ages_s": (0.3, 0.5), "older_spread_s": 0.0}
    whole = training_pair(3, 5, TrainingConfig(**older))
    ages = [seconds_between(s.sweep.stamp_ns, whole.current.stamp_ns) for s in whole.past]
    assert ages == pytest.approx([0.1, 0.3, 0.5])
    worn = training_pair(3, 5, TrainingConfig(**older, lost_rings_share=1.0))
    assert worn.current.ring.max() < whole.current.ring.max()

    def ego_motion(**kind):
        pair = training_pair(3, 5, TrainingConfig(**older, **kind))
        now_T_then = pair.current.world_T_ego.inverse() @ pair.past[2].sweep.world_T_ego
        return np.linalg.norm(now_T_then.translation_m) / 0.5, abs(now_T_then.yaw_rad) / 0.5

    assert ego_motion(turning_share=1.0)[1] > 0.1  # 6 degrees a second
    assert ego_motion(motorway_share=1.0)[0] > 15.0


@pytest.mark.parametrize(
    "wrong",
    [
        {"older_ages_s": (0.2, 0.5)},
        {"older_ages_s": (0.5, 0.3)},
        {"turning_share": 0.6, "motorway_share": 0.6},
    ],
)
def test_unusable_settings_of_training_pairs_are_named(wrong):
    with pytest.raises(ValidationError, match=r"older_ages_s|turning_share"):
        TrainingConfig(**wrong)


@pytest.mark.parametrize(
    ("changes", "words"),
    [({"sensor": "uniform23"}, "uniform32"), ({"sweep_hz": 10, "key_hz": 3}, "divisor")],
)
def test_unusable_settings_are_named(changes, words):
    with pytest.raises(ConfigError, match=words):
        SyntheticDataset(config(**changes))


def test_unknown_scene_and_sweep_are_named():
    dataset = SyntheticDataset(config())
    with pytest.raises(ConfigError, match="synthetic-s0004-0001"):
        dataset.scene("synthetic-s0004-0011")
    with pytest.raises(InputError, match=r"0 \.\. 14"):
        dataset.scene("synthetic-s0004-0001").sweep(15)

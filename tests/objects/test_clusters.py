from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mottrack.core import (
    BevGrid,
    FlowField,
    Frame,
    Objects,
    Pose,
    Sweep,
)
from mottrack.objects.clusters import ClustersConfig, ClusterSource
from mottrack.objects.velocity import VelocityConfig, measure_velocity


def ground(rng: np.random.Generator, slope: float, height_m: float) -> np.ndarray:
    xy = rng.uniform(-30, 30, (20_000, 2))
    return np.column_stack([xy, slope * xy[:, 0] - height_m])


def block(x: float, y: float, size: tuple[float, float, float], base_m: float) -> np.ndarray:
    """Points on the two near sides of a box and on its top, 10 cm apart."""
    length, width, height = size
    z = base_m + np.arange(0.05, height, 0.1)
    along = x + np.arange(-length / 2, length / 2 + 1e-9, 0.1)
    across = y + np.arange(-width / 2, width / 2 + 1e-9, 0.1)
    sides = [
        np.stack(np.meshgrid(along, [y - width / 2], z), -1).reshape(-1, 3),
        np.stack(np.meshgrid([x - length / 2], across, z), -1).reshape(-1, 3),
    ]
    return np.concatenate(sides)


def sweep_of(points: list[np.ndarray], pose: Pose, stamp_ns: int = 10**9) -> Sweep:
    xyz = np.concatenate(points).astype(np.float32)
    return Sweep(xyz, np.zeros(len(xyz), np.float32), stamp_ns, pose)


CAR, POST = (4.0, 1.8, 1.5), (0.3, 0.3, 1.8)


@pytest.mark.parametrize("ground_of", ["terrain", "plane"])
@pytest.mark.parametrize("height_m", [0.0, 0.4, 1.8])
def test_objects_above_the_road(ground_of: str, height_m: float) -> None:
    rng = np.random.default_rng(0)
    pose = Pose.from_yaw(0.3, (400.0, -70.0, 3.0))
    points = [ground(rng, 0.0, height_m)]
    points += [block(10, 5, CAR, -height_m), block(12, -6, POST, -height_m)]
    source = ClusterSource(ClustersConfig(ground=ground_of))
    found = source.objects(Frame(10**9, pose), sweep_of(points, pose))
    assert set(found.label) == {"generic"}
    assert len(found) == 2
    in_ego = found.transformed(pose.inverse(), "ego").select(np.argsort(-found.size_m[:, 0]))
    np.testing.assert_allclose(in_ego.size_m[0, :2], [4.0, 1.8], atol=0.4)
    assert np.abs(in_ego.centre_m[1, :2] - [12, -6]).max() < 0.2
    assert np.linalg.eigvalsh(found.position_covariance_m2).min() > 0
    assert (found.num_points > 20).all()


def test_a_dilated_mask_separates_what_touches() -> None:
    rng, pose = np.random.default_rng(1), Pose.identity()
    points = [ground(rng, 0.0, 1.0), block(10, 0, CAR, -1.0), block(10, 2.0, CAR, -1.0)]
    sweep = sweep_of(points, pose)
    frame = Frame(10**9, pose)
    assert len(ClusterSource().objects(frame, sweep)) == 1
    boxes = Objects(
        stamp_ns=10**9,
        centre_m=np.array([[10, 0, 0.0], [10, 2.0, 0]]),
        size_m=np.tile(CAR, (2, 1)),
        yaw_rad=np.zeros(2),
        label=np.array(["car", "car"]),
        score=np.ones(2),
    )
    parted = ClusterSource().objects(replace(frame, detections=boxes), sweep)
    assert len(parted) == 2
    np.testing.assert_allclose(np.sort(parted.size_m[:, 1]), [1.8, 1.8], atol=0.4)


def test_a_standing_cluster_stays_while_the_vehicle_passes() -> None:
    rng = np.random.default_rng(2)
    source, positions = ClusterSource(), []
    world = np.concatenate([ground(rng, 0.0, 0.0), block(10, 5, POST, 0.0)])
    for k in range(6):
        pose = Pose.from_yaw(0.02 * k, (0.37 * k, 0.0, 1.5))
        local = pose.inverse().apply(world)
        found = source.objects(
            Frame((k + 1) * 10**8, pose), sweep_of([local], pose, (k + 1) * 10**8)
        )
        positions.append(found.centre_m[0])
    assert np.ptp(positions, axis=0).max() < 0.02


def test_velocity_is_sampled_on_the_hull_by_both_rules() -> None:
    grid = BevGrid(x_min_m=0, x_max_m=20, y_min_m=0, y_max_m=20, cell_m=0.5)
    velocity = np.zeros((*grid.shape, 2), np.float32)
    velocity[:, :20] = [4.0, 0.0]
    velocity[:, 20:] = [8.0, 0.0]
    full = np.ones(grid.shape, np.bool_)
    weight = np.where(np.arange(40) < 20, 1.0, 0.5).astype(np.float32) * np.ones(
        grid.shape, np.float32
    )
    field = FlowField(
        grid, velocity, np.zeros((*grid.shape, 2, 2), np.float32), full, full, weight, 1
    )
    triangle = np.array([[8.0, 5.0], [12.0, 5.0], [10.0, 9.0]])
    cluster = Objects(
        stamp_ns=1,
        frame="ego",
        centre_m=np.array([[10.0, 6.5, 0]]),
        size_m=np.array([[4.0, 4.0, 1]]),
        yaw_rad=np.zeros(1),
        label=np.array(["generic"]),
        score=np.ones(1),
        hull=(triangle,),
    )
    mean = measure_velocity(field, cluster)
    weighted = measure_velocity(field, cluster, VelocityConfig(rule="weighted"))
    np.testing.assert_allclose(mean.mean_mps[0], [6.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(weighted.mean_mps[0], [16 / 3, 0.0], atol=1e-5)
    outside = replace(cluster, hull=(triangle + 100.0,), centre_m=cluster.centre_m + 100.0)
    assert not measure_velocity(field, outside).valid[0]


def test_a_height_band_that_holds_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match=r"max_height_m is 0\.3, expected above min_height_m"):
        ClustersConfig(min_height_m=0.3, max_height_m=0.3)


class _Map:
    """Holds the ground where x is positive, 5 m too high."""

    def ground_height(self, xy_m: np.ndarray) -> np.ndarray:
        return np.where(xy_m[:, 0] > 0, 5.0, np.nan)


def test_the_ground_of_a_map_is_used_and_the_estimate_fills_its_gaps() -> None:
    rng, pose = np.random.default_rng(4), Pose.identity()
    points = [ground(rng, 0.0, 1.0), block(10, 0, CAR, -1.0), block(-10, 0, CAR, -1.0)]
    source = ClusterSource()
    source.use_ground(_Map())
    found = source.objects(Frame(10**9, pose), sweep_of(points, pose))
    assert len(found) == 1
    assert found.centre_m[0, 0] < 0
    source.reset()
    assert len(source.objects(Frame(10**9, pose), sweep_of(points, pose))) == 2


@pytest.mark.parametrize("yaw_rad", [0.0, np.pi / 4, 2.0])
def test_the_square_rotates_with_the_vehicle_as_the_grid_of_a_flow_does(yaw_rad: float) -> None:
    pose = Pose.from_yaw(yaw_rad, (400.0, -70.0, 0.0))
    rng = np.random.default_rng(0)
    corner, beyond = block(27.0, -27.0, POST, 0.0), block(33.0, 0.0, POST, 0.0)
    source = ClusterSource(ClustersConfig(reach_m=30.0))
    points = [ground(rng, 0.0, 0.0), corner, beyond]
    found = source.objects(Frame(10**9, pose), sweep_of(points, pose))
    in_ego = found.transformed(pose.inverse(), "ego")
    np.testing.assert_allclose(in_ego.centre_m[:, :2], [[27.0, -27.0]], atol=0.5)

"""Cluster ICP, and the stages around any estimator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mottrack.core.grid import BevGrid
from mottrack.core.motion import FlowField
from mottrack.flow.cluster_icp import ClusterIcpConfig, ClusterIcpFlow
from mottrack.flow.stages import Stages, StagesConfig

GRID = BevGrid(cell_m=0.5)


@pytest.fixture(scope="module")
def source():
    return ClusterIcpFlow(grid=GRID)


@pytest.mark.parametrize(
    ("speed_mps", "yaw_rad"), [(1.5, 0.0), (5.0, 0.7), (14.0, 0.0), (14.0, 2.0), (30.0, 3.1)]
)
def test_a_car_among_walls_and_posts(source, speed_mps, yaw_rad, street_of):
    street = street_of(
        car_start_m=(10.0, 0.0), speed_mps=speed_mps, car_yaw_rad=yaw_rad, ego_mps=6.0
    )
    field = source.estimate([street.sweep(0)], street.sweep(1))
    on_car = street.car_cells(1, GRID) & field.occupied
    expected = speed_mps * np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
    error = np.hypot(*(field.velocity_mps[on_car] - expected).T)
    assert np.median(error) < 0.6
    away = field.occupied & ~on_car
    assert (np.hypot(*field.velocity_mps[away].T) > 0.5).mean() < 0.02


@pytest.mark.parametrize("step", [5, 20])
def test_a_long_gap_costs_no_more_and_the_car_is_found(source, step, street_of):
    street = street_of(speed_mps=14.0)
    field = source.estimate([street.sweep(0)], street.sweep(step))
    on_car = street.car_cells(step, GRID) & field.valid
    error = np.hypot(*(field.velocity_mps[on_car] - [14.0, 0.0]).T)
    assert on_car.any()
    assert np.median(error) < 0.3


def test_the_ends_of_a_turning_car_move_apart(source, street_of):
    street = street_of(car_start_m=(9.0, 2.0), speed_mps=6.0, turn_radps=0.45)
    field = source.estimate([street.sweep(0)], street.sweep(1))
    on_car = street.car_cells(1, GRID) & field.valid
    offset_m = GRID.centres_m()[on_car] - street.car(1).translation_m[:2]
    lateral = field.velocity_mps[on_car][:, 1]
    slope = np.polyfit(offset_m[:, 0], lateral, 1)[0]
    assert slope == pytest.approx(0.45, abs=0.25)


def test_a_pose_error_is_corrected(source, street_of):
    street = street_of(speed_mps=10.0)
    before, now = street.sweep(0), street.sweep(1)
    shifted = replace(before, xyz_m=before.xyz_m + np.array([0.06, -0.05, 0], np.float32))
    field = source.estimate([shifted], now)
    away = field.occupied & ~street.car_cells(1, GRID)
    assert (np.hypot(*field.velocity_mps[away].T) > 0.5).mean() < 0.02


def test_what_was_occluded_does_not_move(source, street_of):
    """A post that was occluded in the first sweep comes into view at rest."""
    street = street_of(speed_mps=0.0, car_start_m=(10.0, 0.0), ego_mps=0.0)
    post = np.random.default_rng(5).normal([14.0, -1.0, 1.0], [0.05, 0.05, 0.4], (60, 3))
    now = street.sweep(1)
    seen = replace(
        now,
        xyz_m=np.concatenate([now.xyz_m, post.astype(np.float32)]),
        reflectance=np.zeros(len(now) + 60, np.float32),
    )
    field = source.estimate([street.sweep(0)], seen)
    rows, cols, _ = GRID.cells(np.array([[14.0, -1.0]]))
    assert np.abs(field.velocity_mps[rows, cols]).max() == 0


def field_with(pair, velocity_mps):
    """A field that is valid on the occupied cells, with velocities (H, W, 2) or one for all.

    It is certain of them to 1 m/s: a refinement keeps what claims to be certain.
    """
    occupied = GRID.occupancy(pair.current.xyz_m)
    blank = FlowField.unmeasured(GRID, occupied, pair.current.stamp_ns)
    velocity = np.where(occupied[..., None], velocity_mps, 0.0)
    certain = np.broadcast_to(np.eye(2, dtype=np.float32), (*GRID.shape, 2, 2))
    return replace(
        blank, velocity_mps=velocity.astype(np.float32), valid=occupied, covariance_m2ps2=certain
    )


@pytest.fixture(scope="module")
def street_pair(street_of):
    street = street_of(car_start_m=(10.0, 0.0), speed_mps=12.0)
    stages = Stages(StagesConfig(), GRID)
    return street, stages, stages.before([street.sweep(0)], street.sweep(1))


def test_the_claimed_motion_of_a_wall_is_withdrawn(street_pair):
    _, stages, pair = street_pair
    wall = field_with(pair, np.where(GRID.centres_m()[..., 1:] > 13, [3.0, 0.0], 0.0))
    assert np.abs(stages.after(wall, pair).velocity_mps).max() == 0


def test_a_velocity_that_is_a_little_off_is_corrected(street_pair):
    street, stages, pair = street_pair
    on_car = street.car_cells(1, GRID)
    guess = field_with(pair, np.where(on_car[..., None], [10.5, 0.8], 0.0))
    refined = stages.after(guess, pair)
    error = refined.velocity_mps[on_car & refined.occupied] - [12.0, 0.0]
    assert np.median(np.hypot(*error.T)) < 0.5


def test_every_stage_can_be_switched_off(street_pair):
    street, _, _ = street_pair
    off = StagesConfig.model_validate(
        {name: {"enabled": False} for name in ("ground", "alignment", "visibility", "refine")}
    )
    stages = Stages(off, GRID)
    pair = stages.before([street.sweep(0)], street.sweep(1))
    assert pair.previous_seen is None
    odometry = street.ego(0).inverse() @ street.ego(1)
    np.testing.assert_array_equal(pair.previous_T_current.matrix, odometry.matrix)
    assert len(pair.current) > 0.9 * len(street.sweep(1))
    field = field_with(pair, np.ones(2))
    assert stages.after(field, pair) is field


def test_config_reaches_the_stages(street_of):
    config = ClusterIcpConfig.model_validate({"stages": {"ground": {"max_height_m": 1.0}}})
    stages = Stages(config.stages, GRID)
    pair = stages.before([street_of().sweep(0)], street_of().sweep(1))
    assert pair.current_height_m.max() < 1.0

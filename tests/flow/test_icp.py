"""ICP of detected objects."""

from __future__ import annotations

import numpy as np
import pytest

from mottrack.core.grid import BevGrid
from mottrack.flow.icp import IcpConfig, IcpFlow

GRID = BevGrid(cell_m=0.5)


def car_velocity(source, street, steps=(0, 1)):
    source.observe(street.frame(steps[-1]))
    field = source.estimate([street.sweep(steps[-2])], street.sweep(steps[-1]))
    on_car = street.car_cells(steps[-1], GRID) & field.valid
    return np.median(field.velocity_mps[on_car], axis=0) if on_car.any() else None


@pytest.mark.parametrize("search", ["along_heading", "everywhere"])
@pytest.mark.parametrize("speed_mps", [0.0, 3.0, 14.0, 30.0])
def test_many_starts_find_any_speed(speed_mps, search, street_of):
    street = street_of(car_start_m=(8.0, -4.0), speed_mps=speed_mps, car_yaw_rad=0.3, ego_mps=5.0)
    velocity = car_velocity(IcpFlow(IcpConfig(search=search), grid=GRID), street)
    expected = speed_mps * np.array([np.cos(0.3), np.sin(0.3)])
    np.testing.assert_allclose(velocity, expected, atol=0.5)


def test_one_start_from_rest_does_not_reach_a_fast_car(street_of):
    street = street_of(speed_mps=30.0, car_start_m=(8.0, -4.0))
    velocity = car_velocity(IcpFlow(IcpConfig(starts=1), grid=GRID), street)
    assert velocity is None or np.hypot(*(velocity - [30, 0])) > 5


def test_a_cluster_of_few_points_is_refused(street_of):
    street = street_of()
    sweep = street.sweep(1)
    car_T_ego = street.car(1).inverse() @ street.ego(1)
    local = car_T_ego.apply(sweep.xyz_m)
    on_car = np.flatnonzero((np.abs(local) < [2.6, 1.3, 1.1]).all(axis=1))
    keep = np.ones(len(sweep), bool)
    keep[on_car[5:]] = False
    source = IcpFlow(grid=GRID)
    source.observe(street.frame(1))
    assert not source.estimate([street.sweep(0)], sweep.select(keep)).valid.any()


def test_cells_outside_every_box_are_not_valid(street_of):
    street = street_of()
    source = IcpFlow(grid=GRID)
    source.observe(street.frame(1))
    field = source.estimate([street.sweep(0)], street.sweep(1))
    assert field.valid.any()
    assert not field.valid[GRID.cells(np.array([[20.0, 14.0]]))[:2]].any()


def test_boxes_of_another_stamp_are_not_used(street_of):
    street = street_of()
    source = IcpFlow(grid=GRID)
    source.observe(street.frame(0))
    assert not source.estimate([street.sweep(0)], street.sweep(1)).valid.any()

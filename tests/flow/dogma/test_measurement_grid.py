"""Masses of one sweep: occupied, free and unknown."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mottrack.flow.dogma.measurement_grid import (
    GROUND,
    OBSTACLE,
    OVERHEAD,
    OWN,
    Returns,
    SensorConfig,
    free_reach_m,
    measure,
)
from mottrack.flow.dogma.window import Window
from mottrack.flow.dogma.workers import Workers

ONE = Workers(1)
WINDOW = Window.around(0.0, 0.0, 120, 0.25)
CENTRE = np.array([0.1, 0.1])


def arc(range_m, kind, low_deg=-180.0, high_deg=180.0, count=2_000):
    azimuth = np.radians(np.linspace(low_deg, high_deg, count, endpoint=False))
    xy_m = range_m * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    return xy_m.astype(np.float32), np.full(count, kind)


def look(*arcs, config=None):
    xy_m = np.concatenate([xy for xy, _ in arcs]) if arcs else np.zeros((0, 2), np.float32)
    kind = np.concatenate([k for _, k in arcs]) if arcs else np.zeros(0, np.uint8)
    return measure(Returns(xy_m, kind, CENTRE), WINDOW, config or SensorConfig(), ONE)


def at(x_m, y_m):
    """Row and column of a place relative to the optical centre."""
    x, y = np.array([x_m, y_m]) + CENTRE - WINDOW.corner_m
    return int(y / 0.25), int(x / 0.25)


@given(st.integers(0, 10_000), st.integers(0, 300), st.floats(0, 0.3))
@settings(deadline=None, max_examples=30)
def test_masses_are_shares_of_one(seed, count, noise_m):
    rng = np.random.default_rng(seed)
    xy_m = rng.normal(0, 12, (count, 2)).astype(np.float32)
    returns = Returns(xy_m, rng.integers(0, 4, count).astype(np.uint8), CENTRE)
    config = SensorConfig(range_noise_m=noise_m, no_return_free_m=5.0)
    occupied, free = measure(returns, WINDOW, config, ONE)
    assert occupied.min() >= 0
    assert free.min() >= 0
    assert (occupied + free).max() < 1


def test_free_before_a_wall_occupied_on_it_unknown_behind():
    occupied, free = look(arc(8.0, OBSTACLE))
    assert free[at(3, 2)] > 0.8
    assert occupied[at(3, 2)] == 0
    assert occupied[at(8.0, 0.0)] > 0.6
    assert free[at(8.0, 0.0)] < 0.2
    assert free[at(11, 0)] == occupied[at(11, 0)] == 0
    assert free[at(2, 0)] > free[at(6, 0)]


def test_the_first_return_ends_the_free_reach_and_later_ones_are_evidence():
    occupied, free = look(arc(6.0, OBSTACLE), arc(10.0, OBSTACLE, -5, 5), arc(12.0, GROUND))
    assert occupied[at(10, 0)] > 0.6
    assert free[at(8, 0)] == 0


def test_returns_of_a_cell_are_fused_by_dempsters_rule():
    config = SensorConfig(occupied_mass=0.4, range_noise_m=0.0)
    for number in (1, 2, 3):
        point = np.tile(np.array([[5.0, 0.0]], np.float32), (number, 1))
        occupied, _ = look((point, np.full(number, OBSTACLE)), config=config)
        np.testing.assert_allclose(occupied[at(5, 0)], 1 - 0.6**number, rtol=1e-5)


def test_range_noise_spreads_along_the_ray_only():
    point = (np.array([[5.02, 0.0]], np.float32), np.full(1, OBSTACLE))
    occupied, _ = look(point, config=SensorConfig(range_noise_m=0.2))
    row, col = at(5.02, 0)
    assert occupied[row, col] > occupied[row, col + 1] > 0
    assert occupied[row, col - 1] > 0
    assert occupied[row + 1, col] == occupied[row - 1, col] == 0


def test_nothing_is_known_outside_the_field_of_view():
    occupied, free = look(arc(10.0, GROUND, -60, 60))
    assert free[at(6, 0)] > 0
    assert free[at(-6, 0)] == free[at(0, 8)] == 0
    assert occupied.max() == 0


@pytest.mark.parametrize("reach_m", [0.0, 7.0])
def test_a_direction_without_return_is_free_as_far_as_configured(reach_m):
    gap = (arc(10.0, GROUND, 3, 357),)
    _, free = look(*gap, config=SensorConfig(no_return_free_m=reach_m))
    assert (free[at(5, 0)] > 0) == (reach_m > 5)
    assert free[at(8, 0)] == 0
    wide = (arc(10.0, GROUND, 30, 330),)
    _, free = look(*wide, config=SensorConfig(no_return_free_m=reach_m))
    assert free[at(5, 0)] == 0


def test_ground_is_free_overhead_is_in_view_and_the_own_vehicle_is_no_evidence():
    def reach_m(returns, no_return_free_m):
        config = SensorConfig(azimuth_bins=360, no_return_free_m=no_return_free_m)
        return free_reach_m(Returns(*returns, CENTRE), config)

    np.testing.assert_allclose(reach_m(arc(9.0, GROUND), 0.0), 9.0, rtol=1e-6)
    np.testing.assert_allclose(reach_m(arc(9.0, OVERHEAD), 4.0), 4.0)
    assert not reach_m(arc(1.0, OWN), 4.0).any()


def test_an_empty_sweep_is_no_evidence():
    occupied, free = look()
    assert occupied.max() == free.max() == 0

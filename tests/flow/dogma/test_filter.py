"""Properties of the filter in a flat world with known motion."""

from __future__ import annotations

import numpy as np
import pytest

from mottrack.core.errors import InputError
from mottrack.flow.dogma.field import ReadoutConfig, is_moving
from mottrack.flow.dogma.filter import DynamicGridFilter, FilterConfig
from mottrack.flow.dogma.measurement_grid import Masses
from mottrack.flow.dogma.window import Window
from mottrack.flow.dogma.workers import Workers

WALL = np.array([[-100.0, 8.0, 100.0, 8.0]])


def measured_velocity(grid_map, cells):
    """(K, 2) velocities of the hit cells that carry one, by the readout's own rule."""
    row, col = cells.T
    occupied = grid_map.masses.occupied[row, col]
    persistent = grid_map.split.persistent[row, col]
    good = (occupied >= 0.6) & (persistent >= 0.5 * occupied)
    return grid_map.moments.velocity_mps[row, col][good]


def test_a_box_at_10_mps_is_known_within_ten_cycles(flat_world, box):
    world = flat_world()
    for k in range(10):
        grid_map, cells = world.cycle(0.0, box((8.0 + k, 1.0), 4.5, 1.9))
    velocity = measured_velocity(grid_map, cells)
    assert len(velocity) >= 5
    assert np.abs(velocity.mean(axis=0) - [10.0, 0.0]).max() < 0.5
    assert is_moving(grid_map, ReadoutConfig())[cells[:, 0], cells[:, 1]].mean() > 0.8


def test_a_wall_stands_still_for_a_vehicle_at_15_mps(flat_world):
    world = flat_world()
    speeds = []
    for k in range(30):
        grid_map, cells = world.cycle(1.5 * k, WALL)
        if k >= 10:
            velocity = measured_velocity(grid_map, cells)
            assert len(velocity) > 0.9 * len(cells)
            speeds.append(np.hypot(*velocity.T).mean())
    assert np.mean(speeds) < 0.3
    assert is_moving(grid_map, ReadoutConfig()).mean() < 0.001


def test_an_empty_world_stays_empty(flat_world):
    world = flat_world()
    nowhere = np.array([[900.0, 900.0, 901.0, 900.0]])
    for k in range(5):
        grid_map, _ = world.cycle(2.0 * k, nowhere)
        assert grid_map.masses.occupied.max() == 0
        assert world.filter.mass_each == 0
    assert grid_map.masses.free.max() > 0.9


def test_occupancy_that_disappears_decays(flat_world, box):
    world = flat_world()
    for _ in range(5):
        world.cycle(0.0, box((8.0, 0.0), 2.0, 2.0))
    for _ in range(8):
        grid_map, _ = world.cycle(0.0, np.array([[900.0, 900.0, 901.0, 900.0]]))
    assert grid_map.masses.occupied.max() < 0.05


def test_masses_add_up_and_the_number_of_particles_is_constant(flat_world, box):
    world = flat_world()
    for k in range(6):
        edges = np.concatenate([WALL, box((5.0 + k, -4.0), 4.0, 2.0)])
        grid_map, _ = world.cycle(1.5 * k, edges)
        masses, split = grid_map.masses, grid_map.split
        assert masses.occupied.min() >= 0
        assert masses.free.min() >= 0
        assert (masses.occupied + masses.free).max() <= 1 + 1e-6
        np.testing.assert_allclose(split.persistent + split.born, masses.occupied, atol=1e-6)
        assert len(world.filter.particles.x_m) == world.config.particles
        carried = world.filter.mass_each * world.config.particles
        np.testing.assert_allclose(carried, masses.occupied.sum(dtype=np.float64), rtol=1e-5)


def test_any_number_of_threads_gives_the_same_map(flat_world, box):
    maps = []
    for threads in (1, 3):
        world = flat_world(threads=threads)
        for k in range(4):
            grid_map, _ = world.cycle(1.5 * k, np.concatenate([WALL, box((6.0 + k, -3.0), 4, 2)]))
        maps.append((grid_map, world.filter.particles))
    (one, particles_one), (three, particles_three) = maps
    for a, b in zip(
        (*one.masses, *one.split, *one.moments, *particles_one),
        (*three.masses, *three.split, *three.moments, *particles_three),
        strict=True,
    ):
        np.testing.assert_array_equal(a, b)


def test_seeds_differ(flat_world):
    particles = []
    for seed in (0, 1):
        world = flat_world(FilterConfig(particles=5_000, births=500, seed=seed))
        world.cycle(0.0, WALL)
        particles.append(world.filter.particles.vx_mps)
    assert not np.array_equal(*particles)


@pytest.mark.parametrize("dt_s", [0.0, -0.1, np.nan, np.inf])
def test_time_must_advance(dt_s):
    window = Window.around(0.0, 0.0, 8, 0.25)
    blank = Masses(np.zeros((8, 8), np.float32), np.zeros((8, 8), np.float32))
    with pytest.raises(InputError, match="dt_s"):
        DynamicGridFilter(FilterConfig(particles=10, births=1), Workers(1)).step(
            blank, window, dt_s
        )


def test_shapes_must_agree():
    blank = Masses(np.zeros((8, 8), np.float32), np.zeros((8, 8), np.float32))
    grid_filter = DynamicGridFilter(FilterConfig(particles=10, births=1), Workers(1))
    with pytest.raises(InputError, match="shape of measured"):
        grid_filter.step(blank, Window.around(0.0, 0.0, 9, 0.25), 0.1)
    grid_filter.step(blank, Window.around(0.0, 0.0, 8, 0.25), 0.1)
    with pytest.raises(InputError, match="window"):
        grid_filter.step(blank, Window.around(0.0, 0.0, 8, 0.5), 0.1)

"""Particles between two cycles: prediction, assignment, birth, moments, resampling."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mottrack.flow.dogma.births import (
    MAX_DRAWS,
    BirthConfig,
    Births,
    VelocityPrior,
    allocate_births,
    draw_births,
)
from mottrack.flow.dogma.noise import stream, uniform
from mottrack.flow.dogma.particles import Particles, assign, velocity_moments
from mottrack.flow.dogma.predict import (
    MotionStep,
    ParticleMotionConfig,
    predict,
    survival_over,
)
from mottrack.flow.dogma.resample import Candidates, resample
from mottrack.flow.dogma.window import Window
from mottrack.flow.dogma.workers import Workers

ONE = Workers(1)
WINDOW = Window.around(0.0, 0.0, 6, 0.5)
UNKNOWN = np.zeros((6, 6), np.float32)
"""Free mass before the prediction: none."""


def scattered(count, seed=0, spread_m=4.0):
    rng = np.random.default_rng(seed)
    place = rng.uniform(-0.5, spread_m, (2, count)).astype(np.float32)
    return Particles(*place, *rng.normal(0, 5, (2, count)).astype(np.float32))


def cell_of(particles):
    col = np.floor(particles.x_m / 0.5).astype(int)
    row = np.floor(particles.y_m / 0.5).astype(int)
    inside = (col >= 0) & (col < 6) & (row >= 0) & (row < 6)
    return np.where(inside, row * 6 + col, 36)


@pytest.mark.parametrize("dt_s", [0.05, 0.1, 0.5])
def test_the_expected_prediction_is_constant_velocity(dt_s):
    count = 200_000
    start = Particles(*(np.full(count, v, np.float32) for v in (20.0, 30.0, 12.0, -7.0)))
    config = ParticleMotionConfig()
    motion = MotionStep.over(dt_s, (-1.5, 0.25), config)
    predict((0, count), start, motion, stream(1, 2, 3))
    growth = np.sqrt(dt_s / 0.1)
    expected = (20 - 1.5 + 12 * dt_s, 30 + 0.25 - 7 * dt_s, 12.0, -7.0)
    deviation = np.repeat([config.position_noise_m, config.velocity_noise_mps], 2) * growth
    for values, mean, sigma in zip(start, expected, deviation, strict=True):
        drawn = values.astype(np.float64)
        assert abs(drawn.mean() - mean) < 5 * sigma / np.sqrt(count) + 1e-5
        np.testing.assert_allclose(drawn.std(), sigma, rtol=0.01)
    assert abs(np.corrcoef(np.stack(start))[np.triu_indices(4, 1)]).max() < 0.02


def test_resting_particles_stay_until_they_start():
    count = 100_000
    particles = Particles.empty(count)
    predict(
        (0, count),
        particles,
        MotionStep.over(0.1, (0.0, 0.0), ParticleMotionConfig(start=0.1)),
        stream(0, 0, 0),
    )
    assert not particles.x_m.any()
    assert not particles.y_m.any()
    moving = np.hypot(particles.vx_mps, particles.vy_mps) > 0
    came_to_rest = 1 - np.exp(-0.5 * (0.3 / 0.4) ** 2)
    np.testing.assert_allclose(moving.mean(), 0.1 * (1 - came_to_rest), rtol=0.05)


def test_survival_compounds():
    config = ParticleMotionConfig(survival=0.9)
    np.testing.assert_allclose(survival_over(0.3, config), 0.9**3)


@given(st.integers(1, 400), st.integers(0, 5))
@settings(deadline=None, max_examples=30)
def test_assignment_is_a_stable_sort_by_cell(count, seed):
    particles = scattered(count, seed)
    order, start = assign(particles, WINDOW, WINDOW, ONE)
    cell = cell_of(particles)
    np.testing.assert_array_equal(order, np.argsort(cell, kind="stable"))
    np.testing.assert_array_equal(np.diff(start), np.bincount(cell, minlength=37)[:36])


def test_moments_are_those_of_numpy():
    particles = scattered(5_000)
    assignment = assign(particles, WINDOW, WINDOW, ONE)
    velocity, covariance = velocity_moments(particles, assignment, (6, 6), ONE)
    cell = cell_of(particles)
    for c in range(36):
        v = np.stack([particles.vx_mps, particles.vy_mps])[:, cell == c].astype(np.float64)
        np.testing.assert_allclose(velocity.reshape(36, 2)[c], v.mean(axis=1), atol=1e-4)
        xx, xy, _, yy = np.cov(v, bias=True).ravel()
        np.testing.assert_allclose(covariance.reshape(36, 3)[c], [xx, xy, yy], rtol=1e-4, atol=1e-4)


@given(st.lists(st.floats(0, 1, width=32), min_size=36, max_size=36), st.integers(1, 500))
@settings(deadline=None, max_examples=50)
def test_births_are_shared_out_in_proportion(born, count):
    mass = np.array(born, np.float32).reshape(6, 6)
    births = allocate_births(mass, count, stream(0, 1, 2))
    share = np.diff(births.start)
    total = mass.sum(dtype=np.float64)
    assert births.start[-1] == (count if total > 0 else 0)
    if total > 0:
        assert np.abs(share - mass.ravel() / total * count).max() < 1 + 1e-6
        np.testing.assert_allclose(births.mass_each * count, total, rtol=1e-6)


def test_births_lie_in_their_cell_and_rest_only_where_uncovered():
    start = np.full(37, 0, np.int64)
    start[9:] = 40_000
    start[22:] = 80_000  # 40000 in cell 8, all uncovered; 40000 in cell 21, all moved in
    uncovered = np.zeros((6, 6), np.float32)
    uncovered[1, 2] = 1
    config = BirthConfig(rest_share=0.5, slow_share=0.4, slow_mps=1.0, fast_mps=12.0)
    prior = VelocityPrior.of(config, uncovered, UNKNOWN, 0.1)
    born = draw_births(Births(start, 1.0), WINDOW, prior, stream(3, 0, 1), ONE)
    cell = cell_of(born)
    assert (cell[:40_000] == 8).all()
    assert (cell[40_000:] == 21).all()
    np.testing.assert_allclose(born.x_m[:40_000].mean(), 1.25, atol=0.01)
    resting = (born.vx_mps == 0) & (born.vy_mps == 0)
    np.testing.assert_allclose(resting[:40_000].mean(), 0.5, atol=0.02)
    assert not resting[40_000:].any()
    mixture = 0.4 * 1.0**2 + 0.6 * 12.0**2
    np.testing.assert_allclose(born.vx_mps[40_000:].var(dtype=np.float64), mixture, rtol=0.05)


def test_nothing_new_comes_out_of_free_space_unless_every_draw_did():
    start = np.zeros(37, np.int64)
    start[22:] = 100_000
    free = np.ones((6, 6), np.float32)
    free[3, :3] = 0  # something was to the left of cell 21, which is free itself

    def share_from_free(free_before, **settings):
        config, uncovered = BirthConfig(**settings), np.zeros((6, 6), np.float32)
        prior = VelocityPrior.of(config, uncovered, free_before, 0.1)
        born = draw_births(Births(start, 1.0), WINDOW, prior, stream(1, 2, 3), ONE)
        came_from = born._replace(
            x_m=born.x_m - born.vx_mps * prior.dt_s, y_m=born.y_m - born.vy_mps * prior.dt_s
        )
        return np.append(free.ravel(), 0)[cell_of(came_from)].mean()

    once = share_from_free(UNKNOWN)
    assert 0.5 < once < 0.9
    often = share_from_free(free)
    np.testing.assert_allclose(often, once**MAX_DRAWS, rtol=0.05)
    assert share_from_free(free, draws=1) == once  # as Nuss et al.: whatever is drawn is born


def candidates(count, births):
    particles = scattered(count)
    assignment = assign(particles, WINDOW, WINDOW, ONE)
    prior = VelocityPrior.of(BirthConfig(), np.ones((6, 6), np.float32), UNKNOWN, 0.1)
    born = draw_births(births, WINDOW, prior, stream(0, 0, 1), ONE)
    return Candidates(particles, assignment, born, births)


@given(st.integers(0, 10_000), st.floats(0, 1, exclude_max=True))
@settings(deadline=None, max_examples=30)
def test_resampling_keeps_mass_and_number(seed, offset):
    rng = np.random.default_rng(seed)
    persistent = rng.uniform(0, 1, (6, 6)).astype(np.float32)
    births = allocate_births(
        rng.uniform(0, 0.3, (6, 6)).astype(np.float32), 200, stream(seed, 0, 0)
    )
    chosen = Particles(*(np.full(3_000, np.nan, np.float32) for _ in range(4)))
    each = resample(candidates(4_000, births), persistent, offset, chosen, ONE)
    assert all(np.isfinite(values).all() for values in chosen)
    total = persistent.sum(dtype=np.float64) + 200 * births.mass_each
    np.testing.assert_allclose(each * 3_000, total, rtol=1e-6)
    mass = persistent.ravel() + np.diff(births.start) * births.mass_each
    number = np.bincount(cell_of(chosen), minlength=36)[:36]
    assert np.abs(number - mass / each).max() < 2


def test_without_mass_nothing_is_drawn():
    births = allocate_births(np.zeros((6, 6), np.float32), 10, stream(0, 0, 0))
    chosen = Particles(*(np.full(7, 3, np.float32) for _ in range(4)))
    assert resample(candidates(50, births), np.zeros((6, 6), np.float32), 0.3, chosen, ONE) == 0
    assert (np.stack(chosen) == 3).all()


def test_streams_are_uniform_and_distinct():
    draws = np.array(
        [uniform(stream(seed, k, s)) for seed in range(5) for k in range(40) for s in range(4)]
    )
    assert len(np.unique(draws)) == 800
    assert abs(draws.mean() - 0.5) < 5 * np.sqrt(1 / 12 / 800)

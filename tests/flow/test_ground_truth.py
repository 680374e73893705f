"""Flow from annotated tracks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mottrack.core.frame import Frame
from mottrack.core.grid import BevGrid
from mottrack.flow.ground_truth import GroundTruthConfig, GroundTruthFlow

GRID = BevGrid(cell_m=0.25)


def estimate(source, street, steps=(0, 1)):
    for step in steps:
        source.observe(street.frame(step))
    return source.estimate([street.sweep(steps[-2])], street.sweep(steps[-1]))


def test_the_labels_velocity_in_the_axes_of_the_ego(street_of):
    street = street_of(car_yaw_rad=0.4, speed_mps=6.0, ego_mps=9.0)
    field = estimate(GroundTruthFlow(grid=GRID), street)
    on_car = street.car_cells(1, GRID) & field.occupied
    expected = 6.0 * np.array([np.cos(0.4), np.sin(0.4)])
    np.testing.assert_allclose(
        field.velocity_mps[on_car], expected[None].repeat(on_car.sum(), 0), atol=1e-5
    )
    assert field.valid[field.occupied].all()


def test_background_rests(street_of):
    street = street_of()
    field = estimate(GroundTruthFlow(grid=GRID), street)
    away = ~street.car_cells(1, BevGrid(cell_m=0.25)) & field.occupied
    moving = np.hypot(*field.velocity_mps[away].T) > 0
    assert moving.mean() < 0.02


def test_label_noise_of_a_parked_car_is_no_motion(street_of):
    field = estimate(GroundTruthFlow(grid=GRID), street_of(speed_mps=0.15))
    assert np.abs(field.velocity_mps).max() == 0
    moving = GroundTruthFlow(GroundTruthConfig(static_below_mps=0.0), grid=GRID)
    assert np.abs(estimate(moving, street_of(speed_mps=0.15)).velocity_mps).max() > 0.1


def test_an_object_of_unknown_velocity_is_not_valid(street_of):
    street = street_of()
    frame = street.frame(1)
    unknown = replace(frame.truth, velocity_mps=np.full((1, 2), np.nan))
    source = GroundTruthFlow(grid=GRID)
    source.observe(replace(frame, truth=unknown))
    field = source.estimate([street.sweep(0)], street.sweep(1))
    on_car = street.car_cells(1, GRID) & field.occupied
    assert not field.valid[on_car].any()
    assert field.valid[field.occupied & ~on_car].mean() > 0.9


def test_a_frame_without_truth_has_no_field(street_of):
    street = street_of()
    source = GroundTruthFlow(grid=GRID)
    source.observe(street.frame(0))
    bare = street.frame(1)
    source.observe(Frame(bare.stamp_ns, bare.world_T_ego))
    assert not source.estimate([street.sweep(0)], street.sweep(1)).valid.any()


def test_without_truth_nothing_is_valid_and_reset_forgets(street_of):
    street = street_of()
    source = GroundTruthFlow(grid=GRID)
    assert estimate(source, street).valid.any()
    source.reset()
    assert not source.estimate([street.sweep(0)], street.sweep(1)).valid.any()

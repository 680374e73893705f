"""Refinement over several past sweeps: what moves keeps its motion, what rests loses it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mottrack.core.grid import BevGrid
from mottrack.core.motion import FlowField
from mottrack.flow.registration.refine import RefineConfig, chosen_past, refine, refine_components
from mottrack.flow.stages import Stages, StagesConfig

GRID = BevGrid(cell_m=0.5)
NOW = 5
"""Step of the current sweep: the past reaches 0.5 s back."""
CLAIM_SIGMA_MPS = 0.7
"""What the network states of slow objects."""


def prepared(street, back=(5, 2)):
    stages = Stages(StagesConfig(), GRID)
    return stages.before([street.sweep(NOW - k) for k in back], street.sweep(NOW))


def claimed(street, pair, velocity_mps):
    """A field in which the car's cells have a velocity, with the stated certainty."""
    occupied = GRID.occupancy(pair.current.xyz_m)
    on_car = street.car_cells(NOW, GRID) & occupied
    blank = FlowField.unmeasured(GRID, occupied, pair.current.stamp_ns)
    velocity = np.where(on_car[..., None], velocity_mps, 0.0).astype(np.float32)
    certain = np.broadcast_to(np.float32(CLAIM_SIGMA_MPS**2) * np.eye(2), (*GRID.shape, 2, 2))
    field = replace(blank, velocity_mps=velocity, valid=occupied, covariance_m2ps2=certain)
    return field, on_car


@pytest.mark.parametrize("speed_mps", [0.8, 1.5, 4.0, 14.0])
def test_a_car_keeps_its_motion_and_the_longer_baseline_corrects_it(street_of, speed_mps):
    street = street_of(car_start_m=(12.0, 4.0), speed_mps=speed_mps)
    pair = prepared(street)
    field, on_car = claimed(street, pair, [speed_mps + 0.6, 0.3])
    refined = refine(field, pair, RefineConfig())
    error = np.hypot(*(refined.velocity_mps[on_car] - [speed_mps, 0.0]).T)
    assert np.median(error) < 0.2
    assert (np.hypot(*refined.velocity_mps[on_car].T) > 0.5).all()


def test_a_parked_car_and_a_wall_lose_a_claimed_motion(street_of):
    street = street_of(car_start_m=(12.0, 4.0), speed_mps=0.0)
    pair = prepared(street)
    field, on_car = claimed(street, pair, [1.5, 0.0])
    refined = refine(field, pair, RefineConfig())
    assert np.abs(refined.velocity_mps[on_car]).max() == 0
    assert refined.valid[on_car].all()
    # the withdrawn motion was real with some probability: the doubt is stated along it
    doubt = refined.covariance_m2ps2[on_car]
    assert (doubt[:, 0, 0] > doubt[:, 1, 1]).all()


def test_the_error_is_what_the_covariance_says(street_of):
    """Over noise of the points: mean d^2 / 2 is 1 where the covariance is right."""
    squared = []
    for seed in range(12):
        street = street_of(car_start_m=(9.0 + seed, 4.0), speed_mps=3.0, seed=seed)
        pair = prepared(street)
        field, _ = claimed(street, pair, [3.5, -0.4])
        motions = refine_components(field, pair, RefineConfig()).motions
        largest = motions.points.argmax()
        error = motions.velocity_mps[largest] - [3.0, 0.0]
        squared.append(error @ np.linalg.inv(motions.covariance_m2ps2[largest]) @ error / 2)
    assert 0.05 < np.mean(squared) < 2.0


def test_past_sweeps_are_chosen_evenly_the_newest_first(street_of):
    pair = prepared(street_of(speed_mps=2.0), back=(5, 4, 3, 2, 1))
    ages = [round(past.elapsed_s, 3) for past in chosen_past(pair, 3)]
    assert ages == [0.1, 0.3, 0.5]
    assert round(chosen_past(pair, 9)[0].elapsed_s, 3) == 0.1
    nothing = replace(
        pair,
        past=(
            replace(pair.past[0], obstacles=pair.current.select(np.zeros(len(pair.current), bool))),
        ),
    )
    assert chosen_past(nothing, 2) == []

"""Refinement over several past sweeps: what moves keeps its motion, what rests loses it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mottrack.core.grid import BevGrid
from mottrack.core.motion import FlowField
from mottrack.core.sweep import Sweep
from mottrack.flow.registration.components import Similar, owners_of_fragments
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


@pytest.mark.parametrize("speed_mps", [0.0, 1.2])
def test_of_slow_cells_the_points_decide(street_of, speed_mps):
    """A network claims a pedestrian at a third of its speed; a parked car keeps what it had."""
    street = street_of(car_start_m=(12.0, 4.0), speed_mps=speed_mps)
    pair = prepared(street)
    field, on_car = claimed(street, pair, [0.35, 0.0])
    refined = refine(field, pair, RefineConfig())
    error = np.hypot(*(refined.velocity_mps[on_car] - [speed_mps, 0.0]).T)
    assert np.median(error) < (0.2 if speed_mps else 0.36)
    np.testing.assert_array_equal(refined.valid, field.valid)


def test_a_claim_that_no_past_sweep_can_judge_is_not_measured(street_of):
    """Behind the wall across, neither where it stands nor where it says that it was is seen."""
    street, rng = street_of(speed_mps=0.0), np.random.default_rng(0)
    hidden_m = np.array([-30.0, 0.0, 0.6]) + rng.uniform(0, 1, (60, 3)) * [0.9, 0.9, 0.9]
    now = street.sweep(NOW)
    now = Sweep(
        np.concatenate([now.xyz_m, hidden_m.astype(np.float32)]),
        np.full(len(now) + 60, 0.5),
        now.stamp_ns,
        now.world_T_ego,
        now.origin_m,
    )
    pair = Stages(StagesConfig(), GRID).before([street.sweep(0), street.sweep(3)], now)
    field, _ = claimed(street, pair, [0.0, 0.0])
    row, col, _ = GRID.cells(hidden_m)
    velocity = np.array(field.velocity_mps)
    velocity[row, col] = [0.0, 5.0]
    refined = refine(replace(field, velocity_mps=velocity), pair, RefineConfig())
    assert field.valid[row, col].all()
    assert not refined.valid[row, col].any()


def test_a_fragment_belongs_to_the_nearest_neighbour_that_moves_alike():
    cells = np.full((3, 12), -1)
    cells[:, :2], cells[1, 5], cells[:, 7:] = 0, 1, 2
    velocity = np.array([[9.0, 0.0], [8.0, 0.0], [1.0, 0.0]])
    fragment = np.array([False, True, False])
    similar = Similar(1.0, 0.35)
    assert owners_of_fragments(cells, velocity, fragment, similar).tolist() == [0, 0, 2]
    apart = velocity * [[-1.0], [1.0], [1.0]]
    assert owners_of_fragments(cells, apart, fragment, similar).tolist() == [0, 1, 2]


def test_claims_that_differ_inside_a_component_make_it_less_certain(street_of):
    street = street_of(car_start_m=(12.0, 4.0), speed_mps=4.0)
    pair = prepared(street)
    field, on_car = claimed(street, pair, [4.0, 0.0])
    row, col = np.nonzero(on_car)
    velocity = np.array(field.velocity_mps)
    velocity[row, col, 1] = np.where((row + col) % 2, 0.4, -0.4)
    alike, differing = (
        refine(one, pair, RefineConfig()).covariance_m2ps2[on_car][:, 1, 1]
        for one in (field, replace(field, velocity_mps=velocity))
    )
    assert (differing > alike + 0.05 * 0.9 * 0.4**2).all()


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

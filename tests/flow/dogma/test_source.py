"""Flow source `dogma`: from sweeps to a flow field in the ego frame."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from mottrack import Pipeline
from mottrack.core.errors import InputError
from mottrack.core.grid import BevGrid
from mottrack.core.pose import Pose, rotation_2d
from mottrack.core.sweep import Sweep
from mottrack.flow.dogma.source import DogmaFlow
from mottrack.objects.velocity import VelocityConfig, measure_velocity

GRID = BevGrid(-20.0, 20.0, -20.0, 20.0, 0.25)
ORIGIN_M = np.array([0.0, 0.0, 1.8])


def config(**more):
    return DogmaFlow.Config(filter={"particles": 60_000, "births": 6_000}, threads=1, **more)


def ground_and_box(box_m, rings, sector_deg, rng):
    """Rings of ground returns at z = 0 and the near face of a box 2 m wide, world frame."""
    azimuth = np.radians(rng.uniform(-sector_deg / 2, sector_deg / 2, rings * 400))
    reach = np.repeat(np.linspace(4.0, 30.0, rings), 400)
    xy_m = reach[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    ground = np.column_stack([xy_m, rng.normal(0, 0.02, len(xy_m))])
    side = rng.uniform(-1, 1, 1_000)
    near = np.column_stack([np.full(1_000, box_m[0] - 1.0), box_m[1] + side])
    shadow = (np.abs(xy_m[:, 1] / xy_m[:, 0] - box_m[1] / box_m[0]) < 0.2) & (xy_m[:, 0] > box_m[0])
    faces = np.column_stack([near, rng.uniform(0.4, 1.6, 1_000)])
    return np.concatenate([ground[~shadow], faces])


def sweep(k, *, yaw_rad=0.0, speed_mps=8.0, rings=32, sector_deg=360.0, empty=False):
    """Sweep number k of a box that drives ahead; the ego vehicle stands, turned by `yaw_rad`."""
    rng = np.random.default_rng(k)
    world_T_ego = Pose.from_yaw(yaw_rad, [4e5, 5e6, 30.0])
    points = ground_and_box((8.0 + 0.1 * k * speed_mps, 1.0), rings, sector_deg, rng)
    points[:, :2] = points[:, :2] @ rotation_2d(-yaw_rad).T
    points = points[:0] if empty else points
    return Sweep(
        points.astype(np.float32),
        np.zeros(len(points), np.float32),
        1_600_000_000_000_000_000 + k * 100_000_000,
        world_T_ego,
        ORIGIN_M,
    )


def drive(source, count=11, **more):
    for k in range(1, count):
        field = source.estimate([sweep(k - 1, **more)], sweep(k, **more))
    return field


def box_cells(field, yaw_rad=0.0, count=10):
    place = rotation_2d(-yaw_rad) @ [8.0 + 0.8 * count, 1.0]
    near = np.hypot(*np.moveaxis(GRID.centres_m() - place, -1, 0)) < 2.0
    return near & field.valid


@pytest.mark.parametrize("rings", [32, 64])
@pytest.mark.parametrize("sector_deg", [360.0, 90.0])
def test_a_driving_box_for_sensors_of_any_resolution_and_view(rings, sector_deg):
    source = DogmaFlow(config(), grid=GRID)
    field = drive(source, rings=rings, sector_deg=sector_deg)
    cells = box_cells(field)
    assert cells.sum() >= 5
    mean = field.velocity_mps[cells].mean(axis=0)
    assert np.abs(mean - [8.0, 0.0]).max() < 0.7
    assert (field.valid <= field.occupied).all()
    assert field.weight[cells].min() >= 0.6
    least = np.linalg.eigvalsh(field.covariance_m2ps2[cells].astype(float))[:, 0]
    assert (least > (0.4 * np.hypot(*field.velocity_mps[cells].T)) ** 2).all()
    assert source.current_map()[1].sum() > 0
    if sector_deg < 360:
        behind = source.grid_map.masses.free[:, : source.grid_map.window.cols // 2 - 8]
        assert behind.max() == 0


def test_the_field_rotates_with_the_ego_frame():
    yaw_rad = 2.0
    straight = drive(DogmaFlow(config(), grid=GRID))
    turned = drive(DogmaFlow(config(), grid=GRID), yaw_rad=yaw_rad)
    expected = straight.velocity_mps[box_cells(straight)].mean(axis=0) @ rotation_2d(-yaw_rad).T
    found = turned.velocity_mps[box_cells(turned, yaw_rad)].mean(axis=0)
    np.testing.assert_allclose(found, expected, atol=0.5)
    along = rotation_2d(-yaw_rad) @ [1.0, 0.0]
    covariance = turned.covariance_m2ps2[box_cells(turned, yaw_rad)].mean(axis=0)
    other = straight.covariance_m2ps2[box_cells(straight)].mean(axis=0)
    np.testing.assert_allclose(along @ covariance @ along, other[0, 0], rtol=0.5, atol=0.3)


def test_reset_begins_anew_and_pairs_may_skip_sweeps():
    source = DogmaFlow(config(), grid=GRID)
    first = drive(source, 4)
    source.reset()
    assert source.grid_map is None
    with pytest.raises(InputError, match="sweeps since reset"):
        source.current_map()
    again = drive(source, 4)
    np.testing.assert_array_equal(first.velocity_mps, again.velocity_mps)
    skipping = DogmaFlow(config(), grid=GRID)
    skipping.estimate([sweep(0)], sweep(1))
    np.testing.assert_array_equal(
        skipping.estimate([sweep(2)], sweep(3)).velocity_mps, first.velocity_mps
    )


def test_static_cells_may_be_reported_as_zero():
    readout = {"zero_static": True}
    source = DogmaFlow(config(readout=readout), grid=GRID)
    field = drive(source, 6, speed_mps=0.0)
    assert field.valid.sum() > 5
    assert not field.velocity_mps.any()


def test_an_empty_sweep_gives_an_empty_field_and_the_map_is_kept():
    source = DogmaFlow(config(), grid=GRID)
    drive(source)
    gone = source.estimate([sweep(10)], sweep(11, empty=True))
    assert not gone.occupied.any()
    assert not gone.valid.any()
    assert source.grid_map.masses.occupied.max() > 0.5
    back = source.estimate([sweep(11, empty=True)], sweep(12))
    assert back.velocity_mps[box_cells(back, count=12)].mean(axis=0)[0] > 6.0
    nothing = DogmaFlow(config(), grid=GRID).estimate([sweep(0, empty=True)], sweep(1, empty=True))
    assert not nothing.valid.any()


def jumped(k, shift_m):
    there = sweep(k)
    pose = there.world_T_ego
    moved = Pose(pose.rotation, pose.translation_m + np.array([shift_m, 0.0, 0.0]))
    return Sweep(there.xyz_m, there.reflectance, there.stamp_ns, moved, there.origin_m)


def test_a_stamp_that_is_not_later_is_refused_and_changes_nothing():
    source = DogmaFlow(config(), grid=GRID)
    drive(source, 4)
    with pytest.raises(InputError, match=r"stamp_ns of current is \d+, expected > \d+"):
        source.estimate([sweep(3)], sweep(2))
    untouched = DogmaFlow(config(), grid=GRID)
    drive(untouched, 4)
    np.testing.assert_array_equal(
        source.estimate([sweep(3)], sweep(4)).velocity_mps,
        untouched.estimate([sweep(3)], sweep(4)).velocity_mps,
    )


@pytest.mark.parametrize(
    "late", [sweep(33, speed_mps=0.0), jumped(4, 100.0)], ids=["3 s gap", "100 m jump"]
)
def test_a_gap_or_a_jump_begins_a_new_map(late):
    source = DogmaFlow(config(), grid=GRID)
    drive(source, 4)
    field = source.estimate([sweep(3)], late)
    assert field.occupied.any()
    assert not field.valid.any()


def test_a_pipeline_continues_after_a_gap():
    few = ("flow.filter.particles=2000", "flow.filter.births=200", "flow.threads=1")
    pipeline = Pipeline.from_config("demo", "flow=dogma", "objects=clusters", *few)
    measured = []
    for k in (0, 1, 2, 33, 34, 35):
        seen = sweep(k, speed_mps=0.0)
        step = pipeline.feed(seen.stamp_ns, seen.xyz_m, seen.world_T_ego, origin_m=ORIGIN_M)
        measured.append(step.field is not None)
    assert measured == [False, True, True, False, True, True]
    assert step.field.valid.any()


def test_a_pipeline_takes_the_covariance_of_section_5b_where_the_source_filters():
    few = ("flow.filter.particles=20000", "flow.filter.births=2000", "flow.threads=1")
    pipeline = Pipeline.from_config("table4_printed", "flow=dogma_printed", *few)
    for k in range(6):
        seen = sweep(k)
        step = pipeline.feed(seen.stamp_ns, seen.xyz_m, seen.world_T_ego, origin_m=ORIGIN_M)
    clusters = step.objects.transformed(seen.world_T_ego.inverse(), "ego")
    settings = VelocityConfig(rule="weighted", covariance="printed")
    expected = measure_velocity(step.field, clusters, settings, filtered=True)
    assert expected.valid.any()
    np.testing.assert_allclose(step.objects.velocity.covariance_m2ps2, expected.covariance_m2ps2)


@pytest.mark.parametrize("wrong", [{"particles": 0}, {"births": 0}, {"particle": 5}])
def test_a_filter_needs_particles(wrong):
    with pytest.raises(ValidationError):
        DogmaFlow.Config(filter=wrong)

"""What every flow source promises, on the same inputs."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest

from mottrack.core.errors import DataError, InputError
from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import FlowSource, FrameObserver
from mottrack.core.pose import Pose
from mottrack.core.sweep import Sweep
from mottrack.flow import FLOWS

GRID = BevGrid(cell_m=0.5)


@pytest.fixture(params=FLOWS)
def source(request):
    module, name = FLOWS[request.param].target.split(":")
    try:
        return getattr(import_module(module), name)(grid=GRID)
    except DataError as error:
        pytest.skip(f"no weights here: {error}")


def observed(source, street, *steps):
    for step in steps:
        if isinstance(source, FrameObserver):
            source.observe(street.frame(step))


def points(xyz, stamp_ns):
    return Sweep(
        np.array(xyz, np.float32).reshape(-1, 3), np.zeros(len(xyz)), stamp_ns, Pose.identity()
    )


def test_a_field_of_the_current_sweep(source, street_of):
    street = street_of()
    assert isinstance(source, FlowSource)
    observed(source, street, 0, 1)
    field = source.estimate(street.sweep(0), street.sweep(1))
    assert field.grid == GRID
    assert field.stamp_ns == street.sweep(1).stamp_ns
    assert field.occupied.sum() > 100
    assert not (field.valid & ~field.occupied).any()
    assert (field.covariance_m2ps2[field.valid][:, [0, 1], [0, 1]] > 0).all()


def test_the_same_input_gives_the_same_field(source, street_of):
    street = street_of()
    fields = []
    for _ in range(2):
        source.reset()
        observed(source, street, 0, 1)
        fields.append(source.estimate(street.sweep(0), street.sweep(1)))
    np.testing.assert_array_equal(fields[0].velocity_mps, fields[1].velocity_mps)
    np.testing.assert_array_equal(fields[0].valid, fields[1].valid)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_hardly_any_points(source, count):
    xyz = [(10.0 + i, 5.0, 1.0) for i in range(count)]
    field = source.estimate(points(xyz, 0), points(xyz, 100_000_000))
    assert field.occupied.sum() <= count
    assert not (field.valid & ~field.occupied).any()
    assert np.isfinite(field.velocity_mps).all()


def test_an_empty_sweep_after_a_full_one(source, street_of):
    full = street_of().sweep(0)
    field = source.estimate(full, points([], full.stamp_ns + 100_000_000))
    assert not field.valid.any()
    assert not field.occupied.any()


def test_a_gap_of_three_seconds_is_an_error_or_a_finite_field(source, street_of):
    street = street_of()
    before = street.sweep(0)
    late = street.sweep(1)
    late = Sweep(late.xyz_m, late.reflectance, before.stamp_ns + 3_000_000_000, late.world_T_ego)
    try:
        field = source.estimate(before, late)
    except InputError as error:
        assert "3.0" in str(error)  # a source that filters may refuse a gap, and says how long
        return
    assert np.isfinite(field.velocity_mps).all()


def test_time_must_go_on(source, street_of):
    sweep = street_of().sweep(0)
    with pytest.raises(InputError, match="stamp_ns"):
        source.estimate(sweep, sweep)

"""Laws that every flow source of the table obeys: a new entry is tested without another line."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

from mottrack.core.errors import DataError, InputError
from mottrack.core.frame import Frame
from mottrack.core.grid import BevGrid
from mottrack.core.interfaces import FlowSource, FrameObserver
from mottrack.core.pose import Pose
from mottrack.core.sweep import Sweep
from mottrack.core.velocity_errors import VelocityErrorModel
from mottrack.flow import FLOWS

GRID = BevGrid(cell_m=0.5)
STREET = {"speed_mps": 8.0, "ego_mps": 4.0}
COLUMNS = ("velocity_mps", "covariance_m2ps2", "occupied", "valid", "weight")


@pytest.fixture(scope="module", params=FLOWS)
def shared_source(request):
    module, name = FLOWS[request.param].target.split(":")
    try:
        return getattr(import_module(module), name)(grid=GRID)
    except DataError as error:
        pytest.skip(f"no weights here: {error}")


@pytest.fixture
def source(shared_source):
    """The source at the start of a scene; its network, where it has one, is loaded once."""
    shared_source.reset()
    return shared_source


def rotated(item, yaw_rad):
    """The same sweep or frame in a world that is rotated about its origin."""
    turned_T_world = Pose.from_yaw(yaw_rad)
    pose = turned_T_world @ item.world_T_ego
    if isinstance(item, Sweep):
        return replace(item, world_T_ego=pose)
    boxes = (each.transformed(turned_T_world, "world") for each in (item.detections, item.truth))
    return Frame(item.stamp_ns, pose, *boxes)


def estimate(source, street, steps=(0, 1), yaw_rad=0.0):
    """The field of the last of consecutive pairs, each frame observed before its sweep."""
    for k, step in enumerate(steps):
        if isinstance(source, FrameObserver):
            source.observe(rotated(street.frame(step), yaw_rad))
        if k:
            pair = [rotated(street.sweep(s), yaw_rad) for s in (steps[k - 1], step)]
            field = source.estimate(pair[:1], pair[1])
    return field


def check_masks(field):
    assert not (field.valid & ~field.occupied).any()
    assert np.isfinite(field.velocity_mps).all()
    covariance = field.covariance_m2ps2[field.valid].astype(np.float64)
    np.testing.assert_allclose(covariance, covariance.swapaxes(1, 2), rtol=1e-5, atol=1e-7)
    assert (np.linalg.eigvalsh(covariance) > 0).all()


def assert_equal(one, other):
    for column in COLUMNS:
        np.testing.assert_array_equal(getattr(one, column), getattr(other, column), column)


def points(xyz, stamp_ns):
    return Sweep(
        np.array(xyz, np.float32).reshape(-1, 3), np.zeros(len(xyz)), stamp_ns, Pose.identity()
    )


def test_the_traits_are_declared(shared_source):
    assert isinstance(shared_source, FlowSource)
    declared = {name for kind in type(shared_source).__mro__[:-1] for name in vars(kind)}
    assert {"stateful", "needs_sweeps", "past_sweeps", "error_model"} <= declared
    assert type(shared_source.stateful) is type(shared_source.needs_sweeps) is bool
    assert shared_source.past_sweeps >= 1
    assert isinstance(shared_source.error_model, VelocityErrorModel)


def test_a_field_of_the_current_sweep_on_the_grid_asked_for(source, street_of):
    street = street_of(**STREET)
    field = estimate(source, street)
    assert field.grid == GRID
    assert field.velocity_mps.shape == (*GRID.shape, 2)
    assert field.stamp_ns == street.sweep(1).stamp_ns
    assert field.occupied.sum() > 100
    check_masks(field)


@pytest.mark.parametrize("every", [5, 1, 0.5], ids=["2 Hz", "10 Hz", "20 Hz"])
def test_a_static_world_is_at_rest_at_every_sweep_rate(source, every, street_of):
    """The street is sampled at 10 Hz; other rates stamp the same sweeps of a parked ego anew."""
    street = street_of(speed_mps=0.0)
    for k in range(3):
        pair = []
        for step in (k, k + 1):
            stamp_ns = 1_000_000_000 + int(step * every * 100_000_000)
            if isinstance(source, FrameObserver):
                frame = street.frame(step)
                boxes = (replace(b, stamp_ns=stamp_ns) for b in (frame.detections, frame.truth))
                source.observe(Frame(stamp_ns, frame.world_T_ego, *boxes))
            pair.append(replace(street.sweep(step), stamp_ns=stamp_ns))
        field = source.estimate(pair[:1], pair[1])
    check_masks(field)
    speed_mps = np.hypot(*field.velocity_mps[field.valid].T)
    assert (speed_mps > 1.0).sum() <= 0.05 * len(speed_mps)


def test_a_reset_starts_anew(source, street_of):
    first = estimate(source, street_of(**STREET))
    source.reset()
    estimate(source, street_of(speed_mps=-3.0, seed=5), (0, 1, 2))
    source.reset()
    assert_equal(estimate(source, street_of(**STREET)), first)


def test_without_state_the_same_pair_gives_the_same_field(source, street_of):
    if source.stateful:
        pytest.skip("a source with state depends on the sweeps before")
    street = street_of(**STREET)
    first = estimate(source, street)
    assert_equal(source.estimate([street.sweep(0)], street.sweep(1)), first)


@pytest.mark.parametrize("yaw_rad", [0.8, -2.5])
def test_a_rotated_world_changes_nothing_in_the_ego_frame(source, yaw_rad, street_of):
    if source.stateful:
        pytest.skip("a world-aligned map has other cells: its own test holds it to a tolerance")
    field = estimate(source, street_of(**STREET))
    source.reset()
    other = estimate(source, street_of(**STREET), yaw_rad=yaw_rad)
    np.testing.assert_array_equal(other.occupied, field.occupied)
    assert (other.valid != field.valid).mean() < 1e-3
    both = field.valid & other.valid
    error_mps = np.hypot(*(other.velocity_mps - field.velocity_mps)[both].T)
    assert (error_mps > 0.05).sum() <= 0.01 * len(error_mps)


@pytest.mark.parametrize("later", [0, -50_000_000])
def test_a_current_sweep_that_is_not_later_is_refused_and_the_source_goes_on(
    source, later, street_of
):
    street = street_of(**STREET)
    expected = estimate(source, street, (0, 1, 2))
    source.reset()
    estimate(source, street, (0, 1))
    now = street.sweep(1)
    with pytest.raises(InputError, match="stamp_ns"):
        source.estimate([now], replace(street.sweep(2), stamp_ns=now.stamp_ns + later))
    for past in ([], [now, street.sweep(0)]):
        with pytest.raises(InputError, match="past"):
            source.estimate(past, street.sweep(2))
    if isinstance(source, FrameObserver):
        source.observe(street.frame(2))
    assert_equal(source.estimate([now], street.sweep(2)), expected)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_hardly_any_points(source, count):
    xyz = [(10.0 + i, 5.0, 1.0) for i in range(count)]
    field = source.estimate([points(xyz, 0)], points(xyz, 100_000_000))
    assert field.occupied.sum() <= count
    check_masks(field)


def test_an_empty_sweep_before_or_after_a_full_one(source, street_of):
    full = street_of().sweep(1)
    empty = points([], full.stamp_ns - 100_000_000)
    field = source.estimate([empty], full)
    assert field.occupied.sum() > 100
    check_masks(field)
    field = source.estimate([full], points([], full.stamp_ns + 100_000_000))
    assert not field.valid.any()
    assert not field.occupied.any()


def test_without_state_a_gap_of_three_seconds_is_estimated(source, street_of):
    if source.stateful:
        pytest.skip("a source with state may refuse a gap")
    street = street_of()
    before = street.sweep(0)
    late = replace(street.sweep(1), stamp_ns=before.stamp_ns + 3_000_000_000)
    check_masks(source.estimate([before], late))

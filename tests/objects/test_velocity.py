"""Velocity of each object from a flow field."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mottrack.core.errors import InputError
from mottrack.core.grid import BevGrid
from mottrack.core.motion import FlowField
from mottrack.core.objects import Objects
from mottrack.core.pose import Pose
from mottrack.objects.velocity import VelocityConfig, measure_velocity

GRID = BevGrid(cell_m=0.25)


def field(velocity_of, occupied=None, weight=None, sigma_mps=0.0):
    xy = GRID.centres_m()
    occupied = np.ones(GRID.shape, bool) if occupied is None else occupied
    covariance = np.broadcast_to(sigma_mps**2 * np.eye(2), (*GRID.shape, 2, 2))
    return FlowField(
        grid=GRID,
        velocity_mps=np.broadcast_to(velocity_of(xy), (*GRID.shape, 2)),
        covariance_m2ps2=covariance,
        occupied=occupied,
        valid=occupied,
        weight=np.ones(GRID.shape) if weight is None else weight,
        stamp_ns=0,
    )


def boxes(centres, yaws, size=(4.0, 2.0, 1.5), frame="ego"):
    n = len(centres)
    return Objects(
        stamp_ns=0,
        frame=frame,
        centre_m=np.column_stack([centres, np.zeros(n)]),
        size_m=np.tile(size, (n, 1)),
        yaw_rad=np.asarray(yaws, float),
        label=np.full(n, "car"),
        score=np.ones(n),
    )


@settings(max_examples=30, deadline=None)
@given(
    x=st.floats(-40, 40),
    y=st.floats(-40, 40),
    yaw=st.floats(-4, 4),
    turn=st.floats(-1, 1),
    vx=st.floats(-20, 20),
    vy=st.floats(-20, 20),
)
def test_rigid_motion_has_the_velocity_of_the_centre(x, y, yaw, turn, vx, vy):
    """v(p) = v + w x (p - c): the mean over a symmetric box is v."""
    rigid = field(
        lambda xy: np.stack([vx - turn * (xy[..., 1] - y), vy + turn * (xy[..., 0] - x)], axis=-1)
    )
    measured = measure_velocity(rigid, boxes([(x, y)], [yaw]))
    assert measured.valid.all()
    # the cells of a box are symmetric about its centre to half a cell
    np.testing.assert_allclose(measured.mean_mps[0], [vx, vy], atol=abs(turn) * 0.2 + 1e-3)
    assert np.linalg.eigvalsh(measured.covariance_m2ps2[0]).min() >= 0.1**2 - 1e-6


@settings(max_examples=20, deadline=None)
@given(quarter=st.integers(1, 3), seed=st.integers(0, 1000))
def test_turning_field_and_box_turns_the_measurement(quarter, seed):
    rng = np.random.default_rng(seed)
    values = rng.normal(0, 5, (*GRID.shape, 2))
    occupied = rng.uniform(size=GRID.shape) < 0.5
    pose = Pose.from_yaw(quarter * np.pi / 2)
    here = boxes(rng.uniform(-30, 30, (4, 2)), rng.uniform(-3, 3, 4))
    plain = measure_velocity(field(lambda _: values, occupied), here)
    # rows grow with y: a quarter turn of the plane is a turn of the array by -90 degrees
    turned_values = np.rot90(values, -quarter) @ pose.rotation[:2, :2].T
    turned = measure_velocity(
        field(lambda _: turned_values, np.rot90(occupied, -quarter)), here.transformed(pose, "ego")
    )
    expected = plain.rotated(quarter * np.pi / 2)
    np.testing.assert_array_equal(turned.valid, expected.valid)
    np.testing.assert_allclose(turned.mean_mps, expected.mean_mps, atol=1e-4)
    np.testing.assert_allclose(turned.covariance_m2ps2, expected.covariance_m2ps2, atol=1e-3)


def test_an_object_without_a_valid_cell_is_masked_not_zero():
    occupied = GRID.centres_m()[..., 0] > 0
    measured = measure_velocity(
        field(lambda _: np.array([3.0, 0.0]), occupied), boxes([(20, 0), (-20, 0)], [0, 0])
    )
    assert measured.valid.tolist() == [True, False]


def test_weights_count_only_where_asked():
    left = GRID.centres_m()[..., 0] < 10
    two = field(
        lambda _: np.where(left[..., None], [0.0, 0.0], [8.0, 0.0]),
        weight=np.where(left, 0.25, 0.75),
    )
    box = boxes([(10, 0)], [0])
    assert measure_velocity(two, box).mean_mps[0, 0] == pytest.approx(4.0)
    weighted = measure_velocity(two, box, VelocityConfig(rule="weighted"))
    assert weighted.mean_mps[0, 0] == pytest.approx(6.0)


def test_covariance_is_spread_over_cells_plus_that_of_the_source_plus_the_floor():
    rng = np.random.default_rng(0)
    noise = rng.normal(0, 2.0, (*GRID.shape, 2))
    config = VelocityConfig(correlated_cells=1.0, floor_mps=0.1)
    measured = measure_velocity(
        field(lambda _: noise, sigma_mps=0.5), boxes([(0, 0)], [0.0], (10.0, 10.0, 2.0)), config
    )
    cells = (10 / 0.25) ** 2
    expected = 4.0 / cells + 0.25 + 0.01
    assert np.diag(measured.covariance_m2ps2[0]) == pytest.approx([expected] * 2, rel=0.05)


def test_a_pedestrian_thinner_than_a_cell_is_still_measured():
    measured = measure_velocity(
        field(lambda _: np.array([1.0, 0.5])), boxes([(5.1, 3.1)], [0.3], (0.1, 0.1, 1.7))
    )
    assert measured.valid.all()


def test_a_hull_of_either_orientation_and_the_box_for_a_hull_without_area():
    left = GRID.centres_m()[..., 0] < 0
    two = field(lambda _: np.where(left[..., None], [0.0, 0.0], [8.0, 0.0]))
    ring = np.array([[-10.0, -1.0], [-2.0, -1.0], [-2.0, 1.0], [-10.0, 1.0]])
    empty = np.zeros((0, 2))
    hulls = (ring, ring[::-1], empty, ring[:2], empty)
    measured = measure_velocity(two, replace(boxes([(10, 0)] * 5, [0] * 5), hull=hulls))
    assert measured.mean_mps[:, 0].tolist() == [0.0, 0.0, 8.0, 8.0, 8.0]
    np.testing.assert_array_equal(measured.covariance_m2ps2[0], measured.covariance_m2ps2[1])


def test_boxes_outside_the_grid_and_none_at_all():
    plain = field(lambda _: np.array([1.0, 0.0]))
    assert measure_velocity(plain, boxes([(500, 0)], [0])).valid.tolist() == [False]
    assert len(measure_velocity(plain, boxes(np.zeros((0, 2)), []))) == 0


def test_boxes_must_be_in_the_ego_frame():
    with pytest.raises(InputError, match="frame of boxes"):
        measure_velocity(field(lambda _: np.zeros(2)), boxes([(0, 0)], [0], frame="world"))


def test_the_covariance_of_section_5b() -> None:
    """DOGMa: the cells' own, weighted by occupancy; PillarFlow: the spread of their flows."""
    rng = np.random.default_rng(5)
    flow = rng.normal(0.0, 2.0, (*GRID.shape, 2))
    weight = rng.uniform(0.1, 1.0, GRID.shape)
    variance = rng.uniform(0.5, 4.0, GRID.shape)
    own = variance[..., None, None] * np.eye(2)
    noisy = replace(field(lambda _: flow, weight=weight), covariance_m2ps2=own.astype(np.float32))
    box = boxes([[3.0, -2.0]], [0.4])
    config = VelocityConfig(rule="weighted", covariance="printed", floor_mps=1e-3)
    x, y = np.moveaxis(GRID.centres_m() - [3.0, -2.0], -1, 0)
    along, across = np.cos(0.4) * x + np.sin(0.4) * y, np.cos(0.4) * y - np.sin(0.4) * x
    inside = (np.abs(along) < 2.0) & (np.abs(across) < 1.0)
    cells, shares = flow[inside], weight[inside] / weight[inside].sum()
    of_dogma = measure_velocity(noisy, box, config, filtered=True)
    np.testing.assert_allclose(of_dogma.mean_mps[0], shares @ cells, rtol=1e-5)
    np.testing.assert_allclose(
        of_dogma.covariance_m2ps2[0], (shares @ variance[inside]) * np.eye(2), atol=1e-5
    )
    of_network = measure_velocity(noisy, box, config)
    np.testing.assert_allclose(
        of_network.covariance_m2ps2[0], np.cov(cells.T, aweights=shares, bias=True), rtol=1e-4
    )


def test_the_covariance_of_few_cells_is_that_of_the_noise():
    """Of cells with independent noise, whose spread one or two cells do not show by themselves."""
    sigma_mps, rng = 2.0, np.random.default_rng(6)
    noise = rng.normal(0.0, sigma_mps, (*GRID.shape, 2))
    centres = np.stack(np.meshgrid(np.arange(-40.0, 40, 4), np.arange(-40.0, 40, 4)), -1)
    small = boxes(centres.reshape(-1, 2), np.zeros(400), size=(0.2, 0.2, 1.0))
    large = boxes(centres.reshape(-1, 2)[:40] + 2.0, np.zeros(40), size=(2.0, 2.0, 1.5))
    both = replace(
        small,
        **{
            name: np.concatenate([getattr(small, name), getattr(large, name)])
            for name in ("centre_m", "size_m", "yaw_rad", "label", "score")
        },
    )
    measured = measure_velocity(field(lambda _: noise), both, VelocityConfig(correlated_cells=1.0))
    for rows in (slice(None, 400), slice(400, None)):
        mean, covariance = measured.mean_mps[rows], measured.covariance_m2ps2[rows]
        stated = np.trace(covariance, axis1=1, axis2=2).mean()
        assert stated == pytest.approx((mean**2).sum(axis=1).mean(), rel=0.25)
        squared = np.einsum("ni,nij,nj->n", mean, np.linalg.inv(covariance), mean)
        # 1 % of a normal law; of estimated covariances a little more
        assert (squared > 9.2).mean() < 0.06

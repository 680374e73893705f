"""The contract of every object source in the table OBJECTS, on the same inputs."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

from mottrack.core import Frame, InputError, Objects, ObjectSource, Pose, Sweep
from mottrack.core.sweep import SECOND_NS
from mottrack.objects import OBJECTS

PERIOD_NS = SECOND_NS // 10
CAR_M = np.array([4.0, 1.8, 1.5])
CARS_XY_M = np.array([[12.0, 6.0], [14.0, -7.0]])
"""Centres of two parked cars, world frame."""


@pytest.fixture(params=OBJECTS)
def source(request: pytest.FixtureRequest) -> ObjectSource:
    module, name = OBJECTS[request.param].target.split(":")
    return getattr(import_module(module), name)()


def street() -> np.ndarray:
    """(N, 3) points of a flat road at z = 0 and of the two cars, world frame."""
    rng = np.random.default_rng(0)
    ground = np.column_stack([rng.uniform(-30, 30, (20_000, 2)), np.zeros(20_000)])
    surface = rng.uniform(-0.5, 0.5, (1500, 3)) * CAR_M
    cars = [surface + np.array([x, y, CAR_M[2] / 2]) for x, y in CARS_XY_M]
    return np.concatenate([ground, *cars])


def boxes(stamp_ns: int) -> Objects:
    n = len(CARS_XY_M)
    return Objects(
        stamp_ns=stamp_ns,
        centre_m=np.column_stack([CARS_XY_M, np.full(n, CAR_M[2] / 2)]),
        size_m=np.tile(CAR_M, (n, 1)),
        yaw_rad=np.zeros(n),
        label=np.full(n, "car"),
        score=np.array([0.9, 0.6]),
    )


def moment(index: int, pose: Pose | None = None) -> tuple[Frame, Sweep]:
    """The street from a pose of the vehicle: 1.7 m above the road, unless said otherwise."""
    stamp_ns = index * PERIOD_NS
    pose = pose or Pose.from_yaw(0.0, (0.0, 0.0, 1.7))
    xyz_m = pose.inverse().apply(street())
    sweep = Sweep(xyz_m, np.zeros(len(xyz_m)), stamp_ns, pose)
    return Frame(stamp_ns, pose, boxes(stamp_ns)), sweep


def by_y(found: Objects) -> Objects:
    return found.select(np.argsort(-found.centre_m[:, 1]))


def test_objects_are_in_the_world_and_carry_no_velocities(source: ObjectSource) -> None:
    assert isinstance(source, ObjectSource)
    frame, sweep = moment(1, Pose.from_yaw(0.4, (3.0, -2.0, 1.7)))
    found = by_y(source.objects(frame, sweep))
    assert (found.frame, found.stamp_ns) == ("world", frame.stamp_ns)
    assert found.velocity is None
    np.testing.assert_allclose(found.centre_m[:, :2], CARS_XY_M, atol=0.3)
    assert (found.score > 0).all()


def test_optional_columns_have_a_row_for_each_object(source: ObjectSource) -> None:
    found = source.objects(*moment(1))
    assert len(found) == 2
    for column in (found.hull, found.position_covariance_m2, found.num_points):
        assert column is None or len(column) == len(found)


def test_detections_below_the_score_of_the_mask_or_filter_are_ignored(source: ObjectSource) -> None:
    kind = type(source)
    config = kind.Config()
    name = "min_score"
    strict = (
        config.model_copy(update={name: 0.7})
        if name in type(config).model_fields
        else config.model_copy(update={"mask": config.mask.model_copy(update={name: 0.7})})
    )
    frame, sweep = moment(1)
    nothing = replace(frame, detections=Objects.empty(frame.stamp_ns))
    kept = kind(strict).objects(frame, sweep)
    if source.needs_detections:
        assert kept.score.tolist() == [0.9]
        assert len(source.objects(nothing, sweep)) == 0
    else:  # detections only constrain the clusters
        assert len(kept) == len(source.objects(nothing, sweep)) == 2


def test_an_empty_sweep_gives_only_what_needs_no_points(source: ObjectSource) -> None:
    frame, sweep = moment(1)
    found = source.objects(frame, sweep.select(np.zeros(len(sweep), bool)))
    assert len(found) == (0 if source.needs_sweeps else 2)


def test_missing_input_is_refused_and_the_next_frame_works(source: ObjectSource) -> None:
    frame, sweep = moment(1)
    if source.needs_sweeps:
        with pytest.raises(InputError, match=r"sweep is absent, expected .*objects=detections"):
            source.objects(frame, None)
    else:
        assert len(source.objects(frame, None)) == 2
    without = replace(frame, detections=None)
    if source.needs_detections:
        with pytest.raises(InputError, match=r"detections is absent, expected .*clusters"):
            source.objects(without, sweep)
    else:
        assert len(source.objects(without, sweep)) == 2
    assert len(source.objects(*moment(2))) == 2


def test_after_a_reset_the_same_input_gives_the_same_objects(source: ObjectSource) -> None:
    drive = [moment(k, Pose.from_yaw(0.02 * k, (0.5 * k, 0.0, 1.7))) for k in range(1, 4)]
    first = [source.objects(*step) for step in drive]
    source.reset()
    for before, step in zip(first, drive, strict=True):
        again = source.objects(*step)
        np.testing.assert_array_equal(again.centre_m, before.centre_m)
        np.testing.assert_array_equal(again.score, before.score)


def test_static_objects_stay_where_they_are_while_the_vehicle_moves(source: ObjectSource) -> None:
    """The rigid motion of the vehicle does not appear in world coordinates."""
    centres = []
    for k in range(1, 6):
        pose = Pose.from_yaw(0.05 * k, (0.9 * k, 0.1 * k, 1.7))
        centres.append(by_y(source.objects(*moment(k, pose))).centre_m)
    assert np.ptp(centres, axis=0).max() < 0.1

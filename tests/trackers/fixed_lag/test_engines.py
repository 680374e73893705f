"""Both engines against each other, the Kalman filter of filterpy and their own contracts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from mottrack.core import InputError
from mottrack.trackers.fixed_lag.config import (
    MissedMotionConfig,
    MotionModelConfig,
    RobustConfig,
)
from mottrack.trackers.fixed_lag.engine import FixedLagEngine
from mottrack.trackers.fixed_lag.motion import process_noise, transition
from mottrack.trackers.fixed_lag.nodes import NodeBatch
from mottrack.trackers.fixed_lag.numpy_engine import NumpyEngine
from mottrack.trackers.fixed_lag.robust import RobustWeights

from .scenario import Step, scenario

gtsam = pytest.importorskip("gtsam")
GtsamEngine = pytest.importorskip("mottrack.trackers.fixed_lag.gtsam_engine").GtsamEngine
NOISE = MotionModelConfig()


def feed(engine: FixedLagEngine, step: Step) -> None:
    for slot in step.ended:
        engine.release(slot)
    assert engine.step(step.batch).all()


def assert_same(engine: FixedLagEngine, reference: FixedLagEngine, slots: np.ndarray) -> None:
    ours, theirs = engine.newest(slots), reference.newest(slots)
    np.testing.assert_allclose(ours.mean, theirs.mean, rtol=0, atol=1e-9)
    np.testing.assert_allclose(ours.covariance, theirs.covariance, rtol=1e-9, atol=1e-12)
    for slot in slots[:6].tolist():
        one, other = engine.smooth(slot, True), reference.smooth(slot, True)
        np.testing.assert_array_equal(one.stamp_ns, other.stamp_ns)
        np.testing.assert_allclose(one.mean, other.mean, rtol=0, atol=1e-9)
        np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("lag_ns", [0, 1_000_000_000, 2_000_000_000])
@pytest.mark.parametrize("separate", [False, True])
def test_gtsam_equals_numpy(lag_ns: int, separate: bool) -> None:
    ours, reference = GtsamEngine(NOISE, lag_ns, separate), NumpyEngine(NOISE, lag_ns)
    for step in scenario(60, 20):
        for engine in (ours, reference):
            feed(engine, step)
        assert_same(ours, reference, step.batch.slot)


def test_robust_windows_are_the_same_in_both_engines() -> None:
    ours, reference = (make(NOISE, 1_000_000_000) for make in (GtsamEngine, NumpyEngine))
    robust, solved = RobustWeights(RobustConfig(), MissedMotionConfig()), 0
    for step in scenario(60, 20, seed=3):
        counts = []
        for engine in (ours, reference):
            feed(engine, step)
            counts.append(robust.refine(engine, step.batch.slot))
        assert counts[0] == counts[1]
        solved += counts[0]
        assert_same(ours, reference, step.batch.slot)
    assert solved > 100


def test_newest_state_equals_filterpy() -> None:
    engine = GtsamEngine(NOISE, 500_000_000)
    steps = list(scenario(25, 1, seed=5))
    kalman, last_ns = None, 0
    for step in steps:
        feed(engine, step)
        batch = step.batch
        if len(batch) == 0:
            continue
        if batch.birth[0]:
            kalman = KalmanFilter(6, 2)
            kalman.x = np.concatenate([batch.position_m[0], np.zeros(4)])
            kalman.P = np.diag([0, 0, 100.0, 100, 9, 9])
            kalman.P[:2, :2] = batch.position_covariance_m2[0] / batch.weight[0, 0]
        else:
            dt_s = np.array([(batch.stamp_ns - last_ns) * 1e-9])
            kalman.predict(F=transition(dt_s)[0], Q=process_noise(dt_s, NOISE)[0])
            noise = batch.position_covariance_m2[0] / batch.weight[0, 0]
            kalman.update(batch.position_m[0], R=noise, H=np.eye(2, 6))
        if batch.has_velocity[0]:
            noise = batch.velocity_covariance_m2ps2[0] / batch.weight[0, 1]
            kalman.update(batch.velocity_mps[0], R=noise, H=np.eye(2, 6, 2))
        last_ns = batch.stamp_ns
        belief = engine.newest(np.array([0]))
        np.testing.assert_allclose(belief.mean[0], kalman.x, rtol=0, atol=1e-9)
        np.testing.assert_allclose(belief.covariance[0], kalman.P, rtol=1e-7, atol=1e-10)


def batch_of(stamp_ns: int, positions: list[list[float]], birth: bool) -> NodeBatch:
    count = len(positions)
    return NodeBatch(
        stamp_ns=stamp_ns,
        slot=np.arange(count),
        birth=np.full(count, birth),
        position_m=np.array(positions, float).reshape(-1, 2),
        position_covariance_m2=np.tile(0.04 * np.eye(2), (count, 1, 1)),
        velocity_mps=np.zeros((count, 2)),
        velocity_covariance_m2ps2=np.tile(np.eye(2), (count, 1, 1)),
        has_velocity=np.zeros(count, np.bool_),
        extent_m=np.full(count, 4.5),
        weight=np.ones((count, 2)),
        innovation=np.zeros((count, 2)),
    )


@pytest.fixture(params=[GtsamEngine, NumpyEngine])
def engine(request: pytest.FixtureRequest) -> FixedLagEngine:
    made: FixedLagEngine = request.param(NOISE, 1_000_000_000)
    return made


def spoil_position(batch: NodeBatch) -> NodeBatch:
    position = batch.position_m.copy()
    position[1] = np.nan
    return replace(batch, position_m=position)


def spoil_covariance(batch: NodeBatch) -> NodeBatch:
    covariance = batch.position_covariance_m2.copy()
    covariance[1] = [[1.0, 2.0], [2.0, 1.0]]
    return replace(batch, position_covariance_m2=covariance)


def spoil_velocity(batch: NodeBatch) -> NodeBatch:
    velocity = batch.velocity_mps.copy()
    velocity[1] = np.inf
    return replace(batch, velocity_mps=velocity, has_velocity=np.arange(len(batch)) == 1)


def unconstrain(batch: NodeBatch) -> NodeBatch:
    covariance = batch.position_covariance_m2.copy()
    covariance[1] = 1e300 * np.eye(2)
    return replace(batch, position_covariance_m2=covariance)


@pytest.mark.parametrize("spoil", [spoil_position, spoil_covariance, spoil_velocity, unconstrain])
def test_a_bad_track_costs_only_itself(engine: FixedLagEngine, spoil: object) -> None:
    slots = np.arange(3)
    engine.step(batch_of(10**9, [[0, 0], [5, 0], [9, 0]], True))
    before = engine.newest(slots)
    bad = spoil(batch_of(11 * 10**8, [[1, 0], [6, 0], [10, 0]], False))
    taken = engine.step(bad)
    assert taken.tolist() == [True, False, True]
    after = engine.newest(slots)
    np.testing.assert_array_equal(after.mean[1], before.mean[1])
    assert (np.abs(after.mean[[0, 2], 0] - [1, 10]) < 0.2).all()
    assert engine.step(batch_of(12 * 10**8, [[2, 0], [7, 0], [11, 0]], False)).all()


def test_a_singular_chain_is_dropped_and_the_frame_retried() -> None:
    engine = GtsamEngine(NOISE, 1_000_000_000)
    engine.step(batch_of(10**9, [[0, 0], [5, 0], [9, 0]], True))
    engine.store["root"][1, 0] = np.eye(6, 7) * [1, 1, 0, 0, 0, 0, 0]  # a position, no prior
    weak = batch_of(11 * 10**8, [[1, 0], [6, 0], [10, 0]], False)
    taken = engine.step(weak)
    assert taken.tolist() == [True, False, True]
    assert np.isfinite(engine.newest(np.array([0, 2])).mean).all()


def test_map_coordinates_cost_no_precision(engine: FixedLagEngine) -> None:
    near = type(engine)(NOISE, 1_000_000_000)
    offset = np.array([4e6, -4e6])
    for step in scenario(30, 4, seed=2):
        for slot in step.ended:
            engine.release(slot)
            near.release(slot)
        near.step(step.batch)
        # whole micrometres survive the sum with 4e6 in double precision to 1e-9
        assert engine.step(replace(step.batch, position_m=step.batch.position_m + offset)).all()
        slots = step.batch.slot
        far_mean = engine.newest(slots).mean
        far_mean[:, :2] -= offset
        np.testing.assert_allclose(far_mean, near.newest(slots).mean, rtol=0, atol=2e-8)


@pytest.mark.parametrize("stamp_ns", [10**9, 10**9 - 1])
def test_a_late_or_repeated_stamp_changes_nothing(engine: FixedLagEngine, stamp_ns: int) -> None:
    engine.step(batch_of(10**9, [[0, 0]], True))
    before = engine.newest(np.array([0]))
    with pytest.raises(InputError, match="stamp_ns"):
        engine.step(batch_of(stamp_ns, [[1, 0]], False))
    np.testing.assert_array_equal(engine.newest(np.array([0])).mean, before.mean)
    assert engine.step(batch_of(11 * 10**8, [[0, 0]], False)).all()


def test_a_step_of_a_microsecond_is_left_out(engine: FixedLagEngine) -> None:
    engine.step(batch_of(10**9, [[0, 0]], True))
    assert not engine.step(batch_of(10**9 + 1000, [[0, 0]], False)).any()


def test_shapes_are_checked_before_gtsam_sees_them() -> None:
    batch = batch_of(10**9, [[0, 0], [1, 1]], True)
    for field, wrong in (
        ("position_m", np.zeros((2, 3))),
        ("position_covariance_m2", np.zeros((2, 3, 3))),
        ("weight", np.ones(2)),
        ("slot", np.array([4, 4])),
    ):
        with pytest.raises(InputError, match=field):
            replace(batch, **{field: wrong})


def test_slots_are_for_one_track_at_a_time(engine: FixedLagEngine) -> None:
    engine.step(batch_of(10**9, [[0, 0]], True))
    with pytest.raises(InputError, match="slot"):
        engine.step(batch_of(11 * 10**8, [[0, 0]], True))
    engine.release(0)
    with pytest.raises(InputError, match="slot"):
        engine.step(batch_of(12 * 10**8, [[0, 0]], False))
    assert engine.step(batch_of(13 * 10**8, [[3, 0]], True)).all()
    assert engine.smooth(0).mean.shape == (1, 6)


def test_an_outlier_loses_its_weight_once_the_window_knows_better(
    engine: FixedLagEngine,
) -> None:
    robust = RobustWeights(RobustConfig(), MissedMotionConfig())
    plain = type(engine)(NOISE, 1_000_000_000)
    for k in range(8):
        x = 3.0 if k == 4 else 0.0
        for each in (engine, plain):
            batch = batch_of((10 + k) * 10**8, [[x, 0]], k == 0)
            each.step(replace(batch, innovation=np.array([[9.0 * (k == 4), 0.0]])))
        robust.refine(engine, np.array([0]))
    assert np.abs(engine.smooth(0).mean[:, 0]).max() < 0.25
    assert np.abs(plain.smooth(0).mean[:, 0]).max() > 0.5

"""What every tracker guarantees: each in the TRACKERS table and each preset in configs/tracker."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from mottrack.core.errors import InputError
from mottrack.core.interfaces import Tracker
from mottrack.core.motion import VelocityMeasurement
from mottrack.core.objects import Objects, Tracks
from mottrack.core.pose import Pose
from mottrack.experiment.plugins import load_part
from mottrack.trackers import TRACKERS

from .conftest import make_workload

CONFIGS = Path(__file__).resolve().parents[2] / "configs" / "tracker"
PRESETS = {path.stem: yaml.safe_load(path.read_text()) or {} for path in CONFIGS.glob("*.yaml")}
SETTINGS: dict[str, dict[str, Any]] = {name: {} for name in TRACKERS} | PRESETS
RECTANGLE_M = np.array([[-2.0, -1.0], [2.0, -1.0], [2.0, 1.0], [-2.0, 1.0]])
START_NS = 10**9

MakeTracker = Callable[[], Tracker]


@pytest.fixture(params=sorted(SETTINGS))
def make(request: pytest.FixtureRequest) -> MakeTracker:
    part = load_part("tracker", {"kind": request.param} | SETTINGS[request.param])
    return part.make


@pytest.fixture(params=["boxes", "hulls"])
def hulls(request: pytest.FixtureRequest) -> bool:
    return request.param == "hulls"


def run(tracker: Tracker, stream: list[Objects]) -> list[Tracks]:
    return [tracker.step(objects.stamp_ns, objects) for objects in stream]


def with_hulls(objects: Objects) -> Objects:
    """The same as clusters of 4 m by 2 m along their headings."""
    cos, sin = np.cos(objects.yaw_rad), np.sin(objects.yaw_rad)
    axes = np.stack([np.stack([cos, sin], axis=1), np.stack([-sin, cos], axis=1)], axis=1)
    corners = objects.centre_m[:, None, :2] + np.einsum("ki,nij->nkj", RECTANGLE_M, axes)
    noise = np.tile(0.05 * np.eye(2), (len(objects), 1, 1))
    return replace(objects, hull=tuple(corners), position_covariance_m2=noise)


def crowd(seed: int, hulls: bool) -> list[Objects]:
    """Random objects at 2 Hz, some without a velocity."""
    rng = np.random.default_rng(seed)
    stream = []
    for objects in make_workload(seed, frames=12, crowd=25):
        n = len(objects)
        root = rng.normal(0, 1, (n, 2, 2))
        covariance = root @ root.swapaxes(1, 2) + 0.1 * np.eye(2)
        velocity = VelocityMeasurement(rng.normal(0, 2, (n, 2)), covariance, rng.random(n) < 0.6)
        moving = objects.with_velocity(velocity)
        stream.append(with_hulls(moving) if hulls else moving)
    return stream


def assert_same_tracks(ours: list[Tracks], expected: list[Tracks], atol: float) -> None:
    """The same tracks in any order, with identities that correspond one to one."""
    identity: dict[int, int] = {}
    for a, b in zip(ours, expected, strict=True):
        assert len(a) == len(b)
        # by position, rounded so that 1e-6 m of difference change no order
        a = a.select(np.lexsort(a.centre_m[:, :2].round(3).T))
        b = b.select(np.lexsort(b.centre_m[:, :2].round(3).T))
        np.testing.assert_allclose(a.centre_m, b.centre_m, atol=atol)
        np.testing.assert_allclose(a.velocity_mps, b.velocity_mps, atol=atol)
        np.testing.assert_allclose(a.score, b.score, atol=atol)
        for one, other in zip(a.id.tolist(), b.id.tolist(), strict=True):
            assert identity.setdefault(one, other) == other
    assert len(set(identity.values())) == len(identity) > 10


def test_a_refused_step_changes_nothing(make: MakeTracker, hulls: bool) -> None:
    stream = crowd(11, hulls)
    expected, tracker = run(make(), stream), make()
    for objects, tracks in zip(stream, expected, strict=True):
        with pytest.raises(InputError, match="frame of objects"):
            tracker.step(objects.stamp_ns, objects.transformed(Pose.identity(), "ego"))
        with pytest.raises(InputError, match="stamp_ns"):
            tracker.step(0.5, objects)  # type: ignore[arg-type]
        got = tracker.step(objects.stamp_ns, objects)
        for stamp_ns in (objects.stamp_ns, objects.stamp_ns - 1):
            with pytest.raises(InputError, match="later than the last step"):
                tracker.step(stamp_ns, objects)
        np.testing.assert_array_equal(got.id, tracks.id)
        np.testing.assert_array_equal(got.state, tracks.state)


@pytest.mark.parametrize("seed", [1, 2])
def test_the_order_of_objects_does_not_matter(make: MakeTracker, hulls: bool, seed: int) -> None:
    stream = crowd(seed, hulls)
    rng = np.random.default_rng(seed)
    shuffled = [objects.select(rng.permutation(len(objects))) for objects in stream]
    assert_same_tracks(run(make(), shuffled), run(make(), stream), atol=1e-9)


HALF_TURNS_ONLY = {"stanford_iprl_tri", "pillarflow"}
"""The published noise differs along x and y of the map, as it was estimated there."""


@pytest.mark.parametrize("yaw_rad", [np.pi, 0.7, -2.2])
def test_tracks_move_with_the_world(
    make: MakeTracker, hulls: bool, yaw_rad: float, request: pytest.FixtureRequest
) -> None:
    if request.node.callspec.params["make"] in HALF_TURNS_ONLY and yaw_rad != np.pi:
        pytest.skip("its noise depends on the axes of the map")
    stream = crowd(3, hulls)
    pose = Pose.from_yaw(yaw_rad, (300.0, -500.0, 3.0))
    moved = [objects.transformed(pose, "world") for objects in stream]
    expected = [tracks.transformed(pose, "world") for tracks in run(make(), stream)]
    assert_same_tracks(run(make(), moved), expected, atol=1e-6)


def steady(times_s: np.ndarray, *, flow: bool, hulls: bool) -> list[Objects]:
    """A car at 8 m/s and a parked one, at these times; with velocities where `flow` is set."""
    rng = np.random.default_rng(0)
    stream = []
    for t in times_s.tolist():
        xy = START_M + VELOCITY_MPS * t + rng.normal(0, 0.01, (2, 2))
        velocity = VelocityMeasurement(
            VELOCITY_MPS, np.tile(0.01 * np.eye(2), (2, 1, 1)), np.ones(2, np.bool_)
        )
        objects = Objects(
            stamp_ns=START_NS + round(t * 1e9),
            centre_m=np.column_stack([xy, np.ones(2)]),
            size_m=np.tile([4.0, 2.0, 1.5], (2, 1)),
            yaw_rad=np.full(2, 0.5),
            label=np.full(2, "car"),
            score=np.full(2, 0.9),
            velocity=velocity if flow else None,
        )
        stream.append(with_hulls(objects) if hulls else objects)
    return stream


START_M = np.array([[10.0, -5.0], [0.0, 20.0]])
VELOCITY_MPS = np.array([8.0 * np.array([np.cos(0.5), np.sin(0.5)]), np.zeros(2)])


def assert_followed(tracks: Tracks, objects: Objects) -> None:
    """One track for each of the two cars, where it is and as fast as it is."""
    assert len(tracks) == 2
    rows = np.argmin(
        np.linalg.norm(tracks.centre_m[:, None] - objects.centre_m[None], axis=2), axis=0
    )
    np.testing.assert_allclose(tracks.centre_m[rows], objects.centre_m, atol=0.2)
    np.testing.assert_allclose(tracks.velocity_mps[rows], VELOCITY_MPS, atol=0.5)
    assert tracks.observed.all()
    assert (tracks.hull is None) == (objects.hull is None)


@pytest.mark.parametrize("flow", [False, True], ids=["no flow", "flow"])
@pytest.mark.parametrize("rate_hz", [2, 5, 10, 20])
def test_steady_motion_is_followed_at_any_rate(
    make: MakeTracker, hulls: bool, rate_hz: int, flow: bool
) -> None:
    stream = steady(np.arange(4 * rate_hz) / rate_hz, flow=flow, hulls=hulls)
    steps = run(make(), stream)
    for tracks, objects in zip(steps[-rate_hz:], stream[-rate_hz:], strict=True):
        assert_followed(tracks, objects)
        assert set(tracks.id.tolist()) == set(steps[-1].id.tolist())


@pytest.mark.parametrize("flow", [False, True], ids=["no flow", "flow"])
def test_gaps_of_several_seconds_are_survived(make: MakeTracker, hulls: bool, flow: bool) -> None:
    before, after = np.arange(20) / 10, np.arange(70, 90) / 10
    stream = steady(np.concatenate([before, after]), flow=flow, hulls=hulls)
    silent = [Objects.empty(START_NS + round(t * 1e8)) for t in range(25, 65, 5)]
    tracker = make()
    steps = run(tracker, [*stream[:20], *silent, *stream[20:]])
    assert len(steps[19 + len(silent)]) == 0
    assert_followed(steps[-1], stream[-1])
    at_once = run(make(), stream)  # five seconds without any step
    assert_followed(at_once[-1], stream[-1])


def test_steps_without_objects_yield_no_tracks(make: MakeTracker) -> None:
    tracker = make()
    assert [len(t) for t in run(tracker, [Objects.empty(k * 10**8) for k in range(1, 9)])] == [
        0
    ] * 8
    stream = steady(np.arange(20) / 10, flow=False, hulls=False)
    assert_followed(run(tracker, stream)[-1], stream[-1])

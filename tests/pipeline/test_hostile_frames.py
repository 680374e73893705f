"""A refused frame costs that frame: every flow, object source and tracker, and hostile input."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from mottrack import Objects, Pipeline, Pose, VelocityMeasurement
from mottrack.core.errors import ConfigError, DataError, MottrackError
from mottrack.flow import FLOWS
from mottrack.objects import OBJECTS
from mottrack.pipeline.stream import Step
from mottrack.trackers import TRACKERS

STEP_NS = 10**8
SMALL = ("grid.x_min_m=-16", "grid.x_max_m=16", "grid.y_min_m=-16", "grid.y_max_m=16")
LIGHT = {
    "dogma": ("flow.filter.particles=2000", "flow.filter.births=200"),
    "pillarflow": ("flow.weights=small",),
}
CHOICES = [
    *((f"flow={name}", *LIGHT.get(name, ())) for name in FLOWS),
    *((f"objects={name}", "flow=cluster_icp") for name in OBJECTS),
    *((f"tracker={name}", "flow=zero") for name in TRACKERS),
    ("tracker=stanford_iprl_tri", "flow=zero"),
    ("objects=clusters", "tracker=fixed_lag", "flow=zero"),
]
RNG = np.random.default_rng(0)
CAR = RNG.uniform(-0.5, 0.5, (300, 3)) * [4.0, 1.8, 1.5] + [10.0, 3.0, 0.8]
ROAD = np.column_stack([RNG.uniform(-20, 20, (2000, 2)), np.zeros(2000)])
POINTS = np.concatenate([ROAD, CAR]).astype(np.float32)
FOUND: dict[str, Any] = {
    "frame": "ego",
    "centre_m": [[10.0, 3.0, 0.8]],
    "size_m": [[4.0, 1.8, 1.5]],
    "yaw_rad": [0.0],
    "label": ["car"],
    "score": [0.9],
}
Frame = dict[str, Any]


def good(k: int, **changes: object) -> Frame:
    """The arguments of `Pipeline.feed` for frame k, before a parked car."""
    return {
        "stamp_ns": k * STEP_NS,
        "points": POINTS,
        "world_T_ego": Pose.identity(),
        "detections": FOUND,
    } | changes


def boxes(**changes: object) -> Callable[[int], Frame]:
    return lambda k: good(k, detections=FOUND | changes)


def frame(**changes: object) -> Callable[[int], Frame]:
    return lambda k: good(k, **changes)


def pose(matrix: object) -> Callable[[int], Frame]:
    return lambda k: good(k, world_T_ego=matrix)


def shifted(*xyz_m: float) -> Pose:
    return Pose.from_yaw(0.0, xyz_m)


def velocity(mean: float, variance: float) -> VelocityMeasurement:
    return VelocityMeasurement(np.full((1, 2), mean), variance * np.eye(2)[None], np.ones(1, bool))


UNUSABLE: dict[str, Callable[[int], Frame]] = {
    "points: NaN": frame(points=np.full((5, 3), np.nan)),
    "points: 1e30": frame(points=np.full((5, 3), 1e30)),
    "points: text": frame(points="points"),
    "points: numbers as text": frame(points=[["1", "2", "3"]]),
    "points: ragged": frame(points=[[1.0, 2.0, 3.0], [1.0]]),
    "points: a mapping": frame(points={"x": 1.0}),
    "points: two columns": frame(points=np.zeros((5, 2))),
    "points: complex": frame(points=np.zeros((5, 3), complex)),
    "points: reflectance of bytes": frame(points=np.full((5, 4), 255.0)),
    "pose: NaN": pose(np.full((4, 4), np.nan)),
    "pose: scaled": pose(np.diag([2.0, 2.0, 2.0, 1.0])),
    "pose: mirrored": pose(np.diag([1.0, -1.0, 1.0, 1.0])),
    "pose: transposed": pose(shifted(3.0, 2.0, 1.0).matrix.T),
    "pose: none": pose(None),
    "pose: text": pose("pose"),
    "pose: nowhere": pose(shifted(1e300, 0.0, 0.0)),
    "stamp: float": frame(stamp_ns=1.5e9),
    "stamp: none": frame(stamp_ns=None),
    "stamp: text": frame(stamp_ns="1"),
    "stamp: the last one": lambda k: good(k, stamp_ns=(k - 1) * STEP_NS),
    "stamp: earlier": frame(stamp_ns=-1),
    "stamp: 65 bits": frame(stamp_ns=2**64),
    "stamp: in centuries": frame(stamp_ns=2**62),
    "detections: text": frame(detections="car"),
    "detections: a list": frame(detections=[FOUND]),
    "detections: no arrays": frame(detections={}),
    "detections: other stamp": lambda k: good(k, detections=Objects.empty(k * STEP_NS + 1)),
    "frame: map": boxes(frame="map"),
    "centre: NaN": boxes(centre_m=[[np.nan, 0.0, 0.0]]),
    "centre: 1e300": boxes(centre_m=[[1e300, 0.0, 0.0]]),
    "centre: ragged": boxes(centre_m=[[1.0, 2.0]]),
    "size: zero": boxes(size_m=[[0.0, 1.0, 1.0]]),
    "size: 1e300": boxes(size_m=[[1e300, 1.0, 1.0]]),
    "yaw: infinite": boxes(yaw_rad=[np.inf]),
    "yaw: 1e300": boxes(yaw_rad=[1e300]),
    "label: none": boxes(label=[None]),
    "score: none": boxes(score=[None]),
    "score: 1e300": boxes(score=[1e300]),
    "rows: two of one": boxes(score=[0.9, 0.8]),
    "velocity: a number": boxes(velocity=3.0),
    "hull: NaN": boxes(hull=([[np.nan, 0.0], [1.0, 0.0], [0.0, 1.0]],)),
}
"""Each is refused before anything has changed."""
ANY_AT_FIRST = ("stamp: the last one", "stamp: earlier", "stamp: in centuries")
UNLIKELY: dict[str, Callable[[int], Frame]] = {
    "no points": frame(points=[]),
    "a lost sweep": frame(points=None),
    "one point": frame(points=[[5.0, 5.0, 1.0]]),
    "points in one place": frame(points=np.tile([[5.0, 5.0, 1.0]], (3000, 1))),
    "points far off": frame(points=POINTS * np.float32(1e6)),
    "no detector": frame(detections=None),
    "no detections": frame(detections={name: "ego" if name == "frame" else [] for name in FOUND}),
    "one box 300 times": boxes(
        **{name: value * 300 for name, value in FOUND.items() if name != "frame"}
    ),
    "a box far off": boxes(centre_m=[[9e7, 0.0, 0.0]]),
    "a flat box": boxes(size_m=[[1e-9, 1e-9, 1e-9]]),
    "a huge box": boxes(size_m=[[9e4, 9e4, 9e4]]),
    "an unknown class": boxes(label=["\x1b[2J" * 50]),
    "an exact velocity": boxes(velocity=velocity(1.0, 0.0)),
    "a velocity of light": boxes(velocity=velocity(9e5, 1e12)),
    "a jump of 100 m": pose(shifted(100.0, 0.0, 0.0)),
    "a jump of 5 km": pose(shifted(5000.0, 0.0, 0.0)),
    "a jump around the Earth": pose(shifted(9e7, 0.0, 0.0)),
    "a jump of the heading": pose(Pose.from_yaw(2.0)),
    "upside down": pose(np.diag([1.0, -1.0, -1.0, 1.0])),
}
"""Each is taken, or costs its frame."""
GAPS_S = (3, 30, 3600, 10**8)


def pipeline_of(chosen: tuple[str, ...]) -> Pipeline:
    try:
        return Pipeline.from_config("demo", *SMALL, *_defaults(chosen))
    except DataError as error:
        pytest.skip(f"no weights here: {error}")


def _defaults(chosen: tuple[str, ...]) -> list[str]:
    usual = {"flow": "flow=zero", "objects": "objects=detections", "tracker": "tracker=kalman"}
    return [
        *(text for key, text in usual.items() if not any(c.startswith(f"{key}=") for c in chosen)),
        *chosen,
    ]


def fed(pipeline: Pipeline, given: Frame) -> Step:
    return pipeline.feed(**given)


@pytest.mark.parametrize("chosen", CHOICES, ids=" ".join)
def test_unusable_input_is_refused_and_changes_nothing(chosen: tuple[str, ...]) -> None:
    disturbed, clean = pipeline_of(chosen), pipeline_of(chosen)
    for k in range(1, 6):
        if k in (1, 4):
            for name, hostile in UNUSABLE.items():
                if k == 1 and name in ANY_AT_FIRST:
                    continue
                with pytest.raises(MottrackError) as caught:
                    fed(disturbed, hostile(k))
                assert "\n" not in str(caught.value), name
        got, expected = fed(disturbed, good(k)), fed(clean, good(k))
    assert len(expected.tracks) > 0
    np.testing.assert_array_equal(got.tracks.state, expected.tracks.state)
    np.testing.assert_array_equal(got.tracks.id, expected.tracks.id)
    if expected.field is not None:
        np.testing.assert_array_equal(got.field.velocity_mps, expected.field.velocity_mps)


@pytest.mark.parametrize("chosen", CHOICES, ids=" ".join)
def test_unlikely_input_costs_its_frame_at_most(chosen: tuple[str, ...]) -> None:
    pipeline, k = pipeline_of(chosen), 0

    def continues(frames: int = 4) -> None:
        nonlocal k
        for _ in range(frames):
            k += 1
            step = fed(pipeline, good(k))
        place = np.array([10.0, 3.0])
        assert np.hypot(*(step.tracks.centre_m[:, :2] - place).T).min(initial=9.0) < 1.5
        assert pipeline.flow.needs_sweeps <= (step.field is not None)

    continues()
    for name, hostile in UNLIKELY.items():
        k += 1
        with contextlib.suppress(MottrackError):
            assert np.isfinite(fed(pipeline, hostile(k)).tracks.state).all(), name
        continues(3)
    for gap_s in GAPS_S:
        k += 10 * gap_s
        continues()


@pytest.mark.parametrize("part", ["flow", "objects", "tracker"])
def test_a_part_that_returns_nothing_is_named(part: str) -> None:
    kinds = {"flow": "SilentFlow", "objects": "SilentObjects", "tracker": "SilentTracker"}
    pipeline = pipeline_of((f"{part}=faulty_plugins:{kinds[part]}",))
    words = {"flow": "flow source", "objects": "object source", "tracker": "tracker"}
    message = f"the {words[part]} returned NoneType, expected "
    with pytest.raises(ConfigError, match=message):
        _ = [fed(pipeline, good(k)) for k in (1, 2)]


def test_the_trackers_refuse_objects_that_are_none() -> None:
    for name in TRACKERS:
        tracker = pipeline_of((f"tracker={name}",)).tracker
        for objects in (None, "car", {}, Objects.empty(7)):
            with pytest.raises(MottrackError, match="objects"):
                tracker.step(5, objects)  # type: ignore[arg-type]
        assert len(tracker.step(5, Objects.empty(5))) == 0

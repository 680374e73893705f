"""Which end of a box is the front: by detections, by motion, and by the direction of motion."""

import numpy as np
import pytest

from mottrack.core.objects import Objects
from mottrack.core.pose import wrap_angle
from mottrack.trackers import KalmanTracker
from mottrack.trackers.kalman.config import HeadingConfig
from mottrack.trackers.kalman.heading import DetectedHeadings, Headings, TrackHeadings
from mottrack.trackers.kalman.observations import Matched, SeenBoxes


def car(step: int, dt_s: float, speed_mps: float, yaw_rad: float) -> Objects:
    return Objects(
        stamp_ns=round(step * dt_s * 1e9) + 1,
        frame="world",
        centre_m=np.array([[speed_mps * step * dt_s, 0.0, 0.8]]),
        size_m=np.array([[4.5, 1.8, 1.6]]),
        yaw_rad=np.array([yaw_rad]),
        label=np.array(["car"]),
        score=np.array([0.9]),
    )


def final_yaw(yaws: list[float], dt_s: float = 0.5, speed_mps: float = 0.0) -> float:
    """The heading published last, when these were detected one after the other."""
    tracker, yaw = KalmanTracker(), np.nan
    for step, detected in enumerate(yaws):
        objects = car(step, dt_s, speed_mps, detected)
        yaw = tracker.step(objects.stamp_ns, objects).yaw_rad[0]
    return float(yaw)


def test_detections_multiply_the_odds() -> None:
    """Bayes' rule by hand: exact detections, a known share of turned ones, no change in between."""
    f = 0.1
    config = HeadingConfig(p_turned=f, prior_detections=1e9, switch_per_s=0.0)
    headings = Headings(config)
    headings.append(np.array([0]))
    offsets, first = [0.1, np.pi, np.pi - 0.2, 0.0, np.pi], np.array([0])
    tracks = TrackHeadings(np.zeros((1, 11)), np.full((1, 5), 0.02))
    for offset in offsets:
        box = np.array([[0.0, 0.0, 0.0, offset, 4.0, 2.0, 1.5]])
        seen = SeenBoxes(box, np.zeros((1, 2, 2)), np.full((1, 5), 0.03))
        detected = DetectedHeadings(seen, first)
        headings.observe_detections(Matched(first, first), detected, tracks, 0.1)
    contradict = sum(offset > 1 for offset in offsets) - sum(offset < 1 for offset in offsets)
    odds = f / (1 - f) * ((1 - f) / f) ** contradict
    assert headings.p_turned[0] == pytest.approx(odds / (1 + odds), rel=1e-6)


def test_a_parked_car_keeps_the_heading_that_most_detections_have() -> None:
    turned = [0.3 + np.pi * (k % 3 == 1) for k in range(18)]
    assert abs(wrap_angle(final_yaw(turned) - 0.3)) < 0.1
    assert abs(wrap_angle(final_yaw([0.3 + np.pi, *turned]) - 0.3)) < 0.1


def test_motion_turns_a_car_that_the_detector_reports_the_wrong_way_round() -> None:
    assert abs(wrap_angle(final_yaw([np.pi] * 12, speed_mps=8.0))) < 0.1
    assert abs(wrap_angle(final_yaw([np.pi] * 12) - np.pi)) < 0.1


def test_who_moves_points_where_it_goes() -> None:
    rng = np.random.default_rng(1)
    detected = rng.normal(0.0, 0.4, (20, 15))
    error = [abs(final_yaw(list(row), 0.5, 8.0)) for row in detected]
    parked = [abs(final_yaw(list(row), 0.5, 0.0)) for row in detected]
    assert np.mean(error) < 0.5 * np.mean(parked)


def test_turned_detections_are_counted_by_class() -> None:
    tracker = KalmanTracker()
    for step in range(60):
        objects = car(step, 0.5, 8.0, np.pi * (step % 5 == 0))
        tracker.step(objects.stamp_ns, objects)
    label = tracker._table.index(np.array(["car"]))
    # 12 of 60 and the prior of 1 of 20
    share = tracker._headings.p_detection_turned(label)[0]
    assert share == pytest.approx(13 / 80, abs=0.03)

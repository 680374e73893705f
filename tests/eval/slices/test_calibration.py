"""Calibration where its value is known in closed form."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mottrack.eval.paired import draw
from mottrack.eval.slices.calibration import Scored, calibration, calibrations

from .scenes import Box, scenes

ONCE = np.ones((1, 1), np.int64)


@given(st.floats(0.0, 1.0), st.integers(1, 50), st.integers(0, 50))
@settings(max_examples=50, deadline=None)
def test_a_single_score_errs_by_its_distance_to_the_share(
    score: float, boxes: int, right: int
) -> None:
    right = min(right, boxes)
    scored = Scored(np.full(boxes, score), np.arange(boxes) < right)
    found = calibration("car", [scored], ONCE)
    assert found.error.value == pytest.approx(abs(right / boxes - score), abs=1e-9)
    assert sum(b.boxes for b in found.bins) == boxes


def test_scores_that_are_probabilities_have_no_error() -> None:
    """10,000 draws a scene: the error that chance leaves is about 0.01."""
    rng = np.random.default_rng(0)
    parts = []
    for _ in range(4):
        score = rng.random(10_000)
        parts.append(Scored(score, rng.random(10_000) < score))
    found = calibration("car", parts, draw(4, 50))
    assert found.error.value < 0.015
    halved = [Scored(part.score / 2, part.right) for part in parts]
    assert calibration("car", halved, draw(4, 50)).error.value == pytest.approx(0.25, abs=0.01)


def test_boxes_are_right_where_an_object_of_their_class_is() -> None:
    truth = [Box(0, 1, 5.0, 0.0), Box(0, 2, 30.0, 0.0, "bus")]
    tracks = [Box(0, 7, 5.5, 0.0, score=0.8), Box(0, 8, 30.0, 0.0, score=0.3)]
    found = calibrations(scenes(truth, tracks, labels=("car", "bus")), ONCE)
    assert not isinstance(found, str)
    together = found[0]
    assert together.boxes == 2
    assert together.error.value == pytest.approx((0.2 + 0.3) / 2)
    assert [b.right.value for b in together.bins if b.boxes] == [0.0, 1.0]


@pytest.mark.parametrize(
    ("scores", "reason"),
    [((0.5, 7.0), "no probabilities"), ((0.9, 0.9), "every track box has the score 0.9")],
)
def test_other_scores_are_not_called_calibrated(scores: tuple[float, float], reason: str) -> None:
    tracks = [Box(0, k, 5.0 + 9 * k, 0.0, score=s) for k, s in enumerate(scores)]
    found = calibrations(scenes([Box(0, 1, 5.0, 0.0)], tracks), ONCE)
    assert isinstance(found, str)
    assert reason in found

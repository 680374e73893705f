"""The weight of scores in association, estimated while tracking."""

import numpy as np
import pytest

from mottrack.core import Objects, Tracks
from mottrack.core.arrays import F64
from mottrack.trackers import KalmanTracker
from mottrack.trackers.kalman.config import AssociationConfig
from mottrack.trackers.kalman.score_evidence import ScoreEvidence

Config = KalmanTracker.Config
NEAR_AND_WEAK, FAR_AND_STRONG = 0.1, 0.25
"""Metres from a track: both far within its gate."""


@pytest.mark.parametrize(("taken", "left", "spread"), [(1.0, -1.5, 1.2), (3.2, 0.5, 3.0)])
def test_the_weight_is_that_of_two_normal_distributions(
    taken: float, left: float, spread: float
) -> None:
    """Their log ratio is linear in x with slope (m_1 - m_0) / V; without detections: the prior."""
    random = np.random.default_rng(3)
    config = AssociationConfig(estimate_score_weight=True, score_weight=0.4)
    evidence = ScoreEvidence(config)
    assert evidence.weight(2).tolist() == [0.4, 0.4]
    assert evidence.log_odds(np.array([-40.0])) == -40.0  # no probability: as it is from now on
    for _ in range(100):
        is_left = random.random(60) < 0.3
        x = random.normal(np.where(is_left, left, taken), spread)
        evidence.record(np.zeros(60, np.int64), evidence.log_odds(x), is_left, 1)
    first, other = evidence.weight(2)
    assert first == pytest.approx((taken - left) / spread**2, rel=0.06)
    assert other == 0.4


def test_scores_that_turn_out_to_be_no_probabilities_are_counted_anew() -> None:
    """Their log-odds so far were those of another scale."""
    evidence = ScoreEvidence(AssociationConfig(estimate_score_weight=True))
    score = np.repeat([0.9, 0.1], 50)
    left = score < 0.5
    evidence.record(np.zeros(100, np.int64), evidence.log_odds(score), left, 1)
    assert evidence.weight(1) > 1.0
    evidence.log_odds(np.array([5.0]))
    assert evidence.weight(1) == 0.0


@pytest.mark.parametrize("tells", [True, False])
def test_a_track_takes_the_stronger_detection_where_scores_tell(tells: bool) -> None:
    """Where false detections are as strong as true ones, it takes the nearer one."""
    tracker = KalmanTracker(Config(nms={"enabled": False}))
    random = np.random.default_rng(7)
    for k in range(30):
        cars, false = random.uniform(0.8, 0.9, 4), random.uniform(0.1, 0.2, 4)
        if not tells:
            cars, false = random.uniform(0.1, 0.9, (2, 4))
        # false ones lie elsewhere in every frame
        aside = random.uniform(100.0, 900.0, 4)
        tracks = _step(tracker, k, np.append(np.arange(4) * 20.0, aside), np.append(cars, false))
    last = _step(tracker, 30, np.array([NEAR_AND_WEAK, FAR_AND_STRONG]), np.array([0.2, 0.85]))
    first = tracks.id[np.argmin(np.abs(tracks.centre_m[:, 0]))]
    assert (last.score[last.id == first][0] > 0.5) == tells


def _step(tracker: KalmanTracker, k: int, x_m: F64, score: F64) -> Tracks:
    count = len(x_m)
    stamp_ns = k * 100_000_000
    return tracker.step(
        stamp_ns,
        Objects(
            stamp_ns=stamp_ns,
            frame="world",
            centre_m=np.column_stack([x_m, np.zeros(count), np.ones(count)]),
            size_m=np.tile([4.5, 1.9, 1.6], (count, 1)),
            yaw_rad=np.zeros(count),
            label=np.full(count, "car"),
            score=score,
        ),
    )

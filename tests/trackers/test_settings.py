"""Settings: presets, life cycle, suppression, stages; and what is refused."""

import numpy as np
import pytest
from pydantic import ValidationError

from mottrack.core.errors import ConfigError
from mottrack.core.objects import Objects, Tracks
from mottrack.trackers import TRACKERS, KalmanTracker
from mottrack.trackers.kalman.clutter import ClutterDensity

Config = KalmanTracker.Config


def cars(stamp_s: float, x: list[float], score: list[float], label: str = "car") -> Objects:
    n = len(x)
    return Objects(
        stamp_ns=round(stamp_s * 1e9),
        frame="world",
        centre_m=np.column_stack([x, np.zeros(n), np.zeros(n)]),
        size_m=np.tile([4.5, 1.9, 1.6], (n, 1)),
        yaw_rad=np.zeros(n),
        label=np.full(n, label),
        score=np.array(score),
    )


def run(tracker: KalmanTracker, frames: list[Objects]) -> list[Tracks]:
    return [tracker.step(objects.stamp_ns, objects) for objects in frames]


def test_a_preset_fills_in_what_is_not_given() -> None:
    config = Config(preset="stanford_iprl_tri", track_management={"min_hits": 2})
    assert (config.time, config.association.gate) == ("frames", 11.0)
    assert (config.track_management.min_hits, config.track_management.undetected_classes) == (
        2,
        "freeze",
    )
    again = Config.model_validate(config.model_dump())
    assert again == config


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"preset": "stanford"}, "stanford_iprl_tri"),
        ({"gate": 3}, "gate"),
        ({"velocity": {"covariance": (1.0, 2.0, 1.0)}}, "positive definite"),
        ({"smooth": True, "time": "frames"}, "smooth needs"),
        ({"association": {"gate": float("nan")}}, "gate"),
        ({"second_stage": {"association": {"score_weight": 0.5}}}, "first stage alone"),
        ({"noise": {"classes": {"car": {"observation": (1.0,)}}}}, "observation"),
    ],
)
def test_what_makes_no_sense_is_refused(settings: dict[str, object], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        Config(**settings)


def test_names_of_tables_and_engines_are_checked() -> None:
    with pytest.raises(ConfigError, match="chiu2020-megvii"):
        KalmanTracker(Config(noise={"table": "chiu"}))
    assert TRACKERS["kalman"].target == "mottrack.trackers.kalman:KalmanTracker"


def test_a_track_is_confirmed_after_a_quarter_of_a_second_at_any_rate() -> None:
    counters = Config(track_management={"rule": "counters", "confirm_s": 0.25})
    for rate, first in ((2, 1), (4, 2), (10, 3), (20, 6)):
        empty = [cars(k / rate, [], []) for k in range(10)]
        seen = [cars((10 + k) / rate, [0.0], [0.9]) for k in range(8)]
        steps = run(KalmanTracker(counters), empty + seen)
        assert [len(s) for s in steps[10:]] == [0] * (first - 1) + [1] * (9 - first)


def test_two_steps_close_together_hide_no_track() -> None:
    frames = [cars(0.1 * k, [0.5 * k], [0.9]) for k in range(10)]
    frames.append(cars(0.901, [4.505], [0.9]))
    assert [len(s) for s in run(KalmanTracker(), frames)][2:] == [1] * 9


def test_an_unseen_object_leaves_the_output_and_returns_with_its_id() -> None:
    frames = [cars(0.1 * k, [0.5 * k], [0.8]) for k in range(20)]
    frames += [cars(0.1 * k, [], []) for k in range(20, 60)]
    steps = run(KalmanTracker(), frames)
    shown = [k for k, s in enumerate(steps) if len(s)]
    assert shown[-1] == 21
    assert not steps[21].observed[0]
    assert steps[21].centre_m[0, 0] == pytest.approx(10.5, abs=0.3)
    back = run(KalmanTracker(), [*frames[:30], cars(3.0, [15.0], [0.8])])
    assert back[-1].id.tolist() == [1]
    gone = run(KalmanTracker(), [*frames, cars(6.0, [30.0], [0.8])])
    assert gone[-1].id.tolist() != [1]


def test_presence_is_that_of_the_bernoulli_filter() -> None:
    management = KalmanTracker.Config().track_management
    frames = [cars(0.5 * k, [0.0], [0.8]) for k in range(3)]
    frames += [cars(0.5 * k, [], []) for k in range(3, 5)]
    presence, scores = management.p_present, []
    for _ in range(2):
        predicted = presence * np.exp(-0.5 / management.mean_life_s)
        missed = 1.0 - management.p_detection
        presence = predicted * missed / (1.0 - predicted * management.p_detection)
        scores.append(0.8 * presence * 3 / (3 + management.prior_misses))
    found = [s.score[0] for s in run(KalmanTracker(), frames)[3:]]
    np.testing.assert_allclose(found, scores, rtol=1e-12)


def test_negative_scores_fall_as_well_while_a_track_coasts() -> None:
    frames = [cars(0.5 * k, [0.0], [-0.5]) for k in range(3)] + [cars(1.5, [], [])]
    score = [float(s.score[0]) for s in run(KalmanTracker(), frames)]
    assert score[0] < score[1] < score[2]
    assert score[3] < score[0]


def test_clutter_density_is_the_posterior_mean_of_a_poisson_rate() -> None:
    config = KalmanTracker.Config().association
    density, area_m2 = ClutterDensity(config), 1e4
    for _ in range(40):
        density.record(np.zeros(12, np.int64), 2, area_m2)
    gates = density.nll_gate(["car", "truck"], area_m2)
    prior, frames = config.clutter_density_per_m2, config.clutter_prior_frames
    assert prior is not None
    rates = np.array([40 * 12 + prior * frames * area_m2, prior * frames * area_m2])
    expected = config.clutter_concentration * rates / ((40 + frames) * area_m2)
    np.testing.assert_allclose(np.exp(-0.5 * gates), expected, rtol=1e-12)


def test_a_heading_is_turned_by_vote_not_by_one_detection() -> None:
    tracker, yaws = KalmanTracker(), []
    for k in range(30):
        objects = cars(0.1 * k, [0.0], [0.9])
        turned = k in (8, 15) or k > 20
        if turned:
            objects = Objects(
                **{f: getattr(objects, f) for f in ("stamp_ns", "frame", "centre_m", "size_m")},
                yaw_rad=np.full(1, np.pi),
                label=objects.label,
                score=objects.score,
            )
        tracks = tracker.step(objects.stamp_ns, objects)
        yaws.append(float(np.cos(tracks.yaw_rad[0])) if len(tracks) else 1.0)
    assert min(yaws[:21]) > 0.9
    assert yaws[-1] < -0.9


def test_weak_detections_keep_a_track_alive_but_start_none() -> None:
    second = {"enabled": True, "score": 0.3}
    management = {"birth_score": 0.3}
    weak = [cars(0.5 * k, [0.0, 40.0], [0.9 if k < 3 else 0.2, 0.2]) for k in range(8)]
    steps = run(KalmanTracker(Config(second_stage=second, track_management=management)), weak)
    assert steps[-1].id.tolist() == [1]
    assert steps[-1].observed.tolist() == [True]


def test_scores_are_last_mean_or_belief() -> None:
    frames = [cars(0.5 * k, [0.0], [s]) for k, s in enumerate((0.9, 0.5, 0.4))]
    expected = {"last": 0.4, "mean": 0.6, "confidence": 1 - 0.1 * 0.5 * 0.6}
    for kind, value in expected.items():
        steps = run(
            KalmanTracker(Config(track_management={"rule": "counters", "score": kind})), frames
        )
        assert steps[-1].score[0] == pytest.approx(value)


def test_duplicates_are_suppressed_and_classes_may_be_ignored() -> None:
    double = cars(0.0, [0.0, 0.3], [0.9, 0.8])
    assert len(KalmanTracker().step(0, double)) == 1
    assert len(KalmanTracker(Config(nms={"enabled": False})).step(0, double)) == 2
    agnostic = KalmanTracker(Config(association={"class_aware": False}))
    aware = KalmanTracker()
    for tracker, ids in ((agnostic, [1]), (aware, [2])):
        tracker.step(0, cars(0.0, [0.0], [0.9]))
        tracks = tracker.step(10**9 // 2, cars(0.5, [0.0], [0.9], "truck"))
        assert tracks.select(tracks.observed).id.tolist() == ids


@pytest.mark.parametrize(
    ("metric", "gate"),
    [("centre", 3.0), ("iou_bev", 0.9), ("iou_3d", 0.9), ("giou_bev", 1.5), ("giou_3d", 1.5)],
)
def test_every_metric_keeps_slow_cars_apart(metric: str, gate: float) -> None:
    association = {
        "metric": metric,
        "gate": gate,
        "clutter_density_per_m2": None,
        "max_distance_m": 6.0,
    }
    tracker = KalmanTracker(Config(association=association))
    frames = [cars(0.1 * k, [0.2 * k, 8.0 - 0.2 * k, 30.0], [0.9] * 3) for k in range(12)]
    assert run(tracker, frames)[-1].id.tolist() == [1, 2, 3]


def test_a_duplicate_nearer_by_does_not_take_a_track() -> None:
    """Of two detections inside the gate the stronger one goes on; the gate asks no score."""
    frames = [cars(0.1 * k, [0.0], [0.9]) for k in range(8)]
    both = [*frames, cars(0.8, [0.1, 3.2], [0.2, 0.9])]
    without_nms = {"nms": {"enabled": False}}
    for weight, nearest in ((0.0, 0.1), (0.75, 0.1)):
        far = run(KalmanTracker(Config(association={"score_weight": weight}, **without_nms)), both)
        assert far[-1].centre_m[far[-1].id == 1, 0] == pytest.approx(nearest, abs=0.2)
    near = [*frames, cars(0.8, [0.10, 0.25], [0.2, 0.9])]
    for weight, score in ((0.0, 0.2), (0.75, 0.9)):
        config = Config(association={"score_weight": weight}, **without_nms)
        last = run(KalmanTracker(config), near)[-1]
        trust = 9 / (9 + 2 * config.track_management.prior_misses)
        assert last.score[last.id == 1] == pytest.approx(
            score * config.track_management.p_present * trust
        )


def test_detections_in_quick_succession_count_as_few() -> None:
    """Five in half a second rank as one would: false alarms repeat themselves as well."""
    rule = {"independent_s": 0.5}
    quick = run(
        KalmanTracker(Config(track_management=rule)),
        [cars(0.1 * k, [0.0], [0.8]) for k in range(5)],
    )
    slow = run(KalmanTracker(Config(track_management=rule)), [cars(0.0, [0.0], [0.8])])
    assert quick[-1].score[0] == pytest.approx(slow[-1].score[0])

"""Metrics of a resample from counters per scene, and the differences of two submissions."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from mottrack.eval.nuscenes.boxes import BoxTable, GroundTruth, Prepared, Samples
from mottrack.eval.nuscenes.metrics import evaluate_prepared
from mottrack.eval.nuscenes.prepare import prepare
from mottrack.eval.nuscenes.resampling import (
    differences,
    evaluate_weighted,
    profiles,
    sampled_metrics,
)
from mottrack.eval.nuscenes.rules import Rules
from mottrack.eval.paired import PairedDifference, draw

Maker = Callable[..., tuple[GroundTruth, BoxTable]]
RULES = Rules()
COUNTS = ("gt", "tp", "fp", "fn", "ids", "frag", "mt", "ml")


def resampled(prepared: Prepared, weight: np.ndarray) -> Prepared:
    """The data in which scene s is there `weight[s]` times, under new identities."""
    samples = prepared.samples
    scenes = np.repeat(np.arange(len(weight)), weight)
    rows = [np.arange(samples.first[s], samples.first[s + 1]) for s in scenes]
    edges = np.cumsum([0, *(len(part) for part in rows)])
    copied = Samples(
        np.array([f"{samples.scene_name[s]}#{k}" for k, s in enumerate(scenes)]),
        edges,
        *(getattr(samples, n)[np.concatenate(rows)] for n in ("token", "stamp_us", "ego_xy_m")),
    )

    def copies(boxes: BoxTable) -> BoxTable:
        scene_of_box = samples.scene_of_sample()[boxes.sample]
        parts = []
        for k, s in enumerate(scenes):
            part = boxes.select(scene_of_box == s)
            sample = part.sample - samples.first[s] + edges[k]
            parts.append(replace(part, sample=sample, track=part.track + 1000 * k))
        return BoxTable.stacked(*parts)

    return Prepared(copied, copies(prepared.truth), copies(prepared.tracks))


@pytest.mark.parametrize("seed", range(5))
def test_counters_of_scenes_give_the_metrics_of_a_new_evaluation(
    make_problem: Maker, seed: int
) -> None:
    data = prepare(*make_problem(seed, scenes=5), RULES)
    classes = profiles(data, RULES)
    for weight in np.vstack([np.ones(5, np.int64), draw(5, 6, seed)]):
        fast = evaluate_weighted(classes, weight, RULES).by_class()
        exact = evaluate_prepared(resampled(data, weight), RULES).by_class()
        for label, metrics in exact.items():
            for name, value in metrics.items():
                tolerance = 0.0 if name in COUNTS and label != "all" else 1e-9
                expected = pytest.approx(value, abs=tolerance, rel=0, nan_ok=True)
                assert fast[label][name] == expected, (label, name)


def compared(make_problem: Maker, shift_m: float) -> dict[str, PairedDifference]:
    """Differences of "all" when the tracks of a second submission are shifted."""
    truth, tracks = make_problem(2, scenes=8)
    shifted = replace(tracks, centre_m=tracks.centre_m + np.array([shift_m, 0.0, 0.0]))
    weights = draw(8, 60)
    sides = [
        sampled_metrics(profiles(prepare(truth, boxes, RULES), RULES), weights, RULES)
        for boxes in (tracks, shifted)
    ]
    return {d.key.metric: d for d in differences(*sides) if d.key.row == "all"}


def test_a_worse_submission_is_significantly_worse(make_problem: Maker) -> None:
    found = compared(make_problem, 1.2)
    for name in ("amota", "amotp", "fn"):
        assert found[name].better is False, name
    assert found["amota"].difference < 0 < found["fn"].difference
    assert found["amota"].scenes == 8


def test_equal_submissions_do_not_differ(make_problem: Maker) -> None:
    for found in compared(make_problem, 0.0).values():
        assert (found.low, found.high, found.significant) == (0.0, 0.0, False)


def test_a_class_counts_the_scenes_that_hold_it(make_problem: Maker) -> None:
    data = prepare(*make_problem(1, scenes=6), RULES)
    sampled = sampled_metrics(profiles(data, RULES), draw(6, 30), RULES)
    scene_of_sample = data.samples.scene_of_sample()
    for label, name in enumerate(RULES.classes):
        boxes = [t.sample[t.label == label] for t in (data.truth, data.tracks)]
        scenes = np.unique(scene_of_sample[np.concatenate(boxes)])
        assert np.flatnonzero(sampled[name]["amota"].present).tolist() == scenes.tolist()
    low, high = sampled["all"]["amota"].interval()
    assert low < sampled["all"]["amota"].value < high

"""Errors by kind: a scene in which each kind occurs, and sums equal to the official counts."""

from collections.abc import Callable

import numpy as np
import pytest

from mottrack.eval.clear import MISSES
from mottrack.eval.nuscenes.boxes import BoxTable, GroundTruth, Prepared, Samples
from mottrack.eval.nuscenes.error_classes import (
    FALSE_POSITIVES,
    SWITCHES,
    ErrorClassifier,
    truth_speeds,
)
from mottrack.eval.nuscenes.error_counts import as_plain, classify_errors, format_errors
from mottrack.eval.nuscenes.metrics import class_scenes, evaluate_prepared
from mottrack.eval.nuscenes.prepare import prepare
from mottrack.eval.nuscenes.rules import Rules

RULES = Rules()
CAR, TRUCK = 2, 6
Row = tuple[int, int, int, float, float]
"""Sample, track, class, x, y."""


def table(rows: list[Row]) -> BoxTable:
    values = np.array(sorted(rows), np.float64)
    return BoxTable(
        sample=values[:, 0].astype(np.int64),
        track=values[:, 1].astype(np.int64),
        label=values[:, 2].astype(np.int8),
        centre_m=np.column_stack([values[:, 3:5], np.zeros(len(values))]),
        score=np.full(len(values), 0.5),
        num_points=np.full(len(values), 1),
    )


def scene() -> Prepared:
    frames = 8
    truth: list[Row] = [(f, 0, CAR, 0.0, 0.0) for f in range(frames)]
    truth += [(f, 1, CAR, 10.0, 0.0) for f in range(frames)]
    truth += [(f, 2, CAR, 20.0, 0.0) for f in range(frames)]
    truth += [(f, 3, TRUCK, 30.0, 0.0) for f in range(frames)]
    tracks: list[Row] = []
    # object 0: found in frame 1, lost in 3, again from 4 to 6; a duplicate in frame 5
    tracks += [(f, 10, CAR, 0.0, 0.0) for f in (1, 2, 4, 5, 6)] + [(5, 11, CAR, 0.5, 0.0)]
    # objects 1 and 2 exchange identities in frame 4; object 1 gets a new one in 6, that of 0 in 7
    tracks += [(f, 20 if f < 4 else 30, CAR, 10.0, 0.0) for f in range(6)]
    tracks += [(f, 30 if f < 4 else 20, CAR, 20.0, 0.0) for f in range(frames)]
    tracks += [(6, 40, CAR, 10.0, 0.0), (7, 10, CAR, 10.0, 0.0)]
    # a car where a truck is, a car 3 m off, a car in the middle of nowhere
    tracks += [(0, 50, CAR, 30.0, 0.5), (0, 51, CAR, 0.0, 3.0), (0, 52, CAR, -30.0, 0.0)]
    samples = Samples(
        np.array(["s"]),
        np.array([0, frames]),
        np.array([str(k) for k in range(frames)]),
        np.arange(frames) * 500_000,
        np.zeros((frames, 2)),
    )
    return Prepared(samples, table(truth), table(tracks))


def test_each_kind_is_found() -> None:
    data = scene()
    scenes = class_scenes(data, CAR, RULES)
    counts = ErrorClassifier.of(data, CAR, RULES, scenes).errors(0.0).count()
    assert counts == {
        "late start": 1,
        "gap": 1,
        "early end": 1,
        "never found": 0,
        "duplicate": 1,
        "wrong class": 1,
        "near miss": 1,
        "background": 1,
        "swap": 2,
        "take-over": 1,
        "re-identification": 1,
    }


@pytest.mark.parametrize("seed", range(4))
def test_kinds_add_up_to_the_official_counts(
    make_problem: Callable[..., tuple[GroundTruth, BoxTable]], seed: int
) -> None:
    data = prepare(*make_problem(seed), RULES)
    metrics = evaluate_prepared(data, RULES)
    errors = classify_errors([data], metrics)
    assert errors
    for name, part in errors.items():
        official = metrics.classes[name]
        for kinds, total in ((MISSES, "fn"), (FALSE_POSITIVES, "fp"), (SWITCHES, "ids")):
            assert sum(part.counts[kind] for kind in kinds) == official[total]
        assert part.amota == pytest.approx(official["amota"], abs=1e-12)
        assert all(without >= part.amota - 1e-12 for without in part.amota_without.values())
        assert sum(sum(row.values()) for row in part.by_range.values()) == sum(part.counts.values())
    assert "background" in format_errors(errors)
    assert set(as_plain(errors)) == set(errors)


def test_speed_of_a_true_box_is_that_between_its_neighbours() -> None:
    data = scene()
    assert not truth_speeds(data).any()
    moving = BoxTable(
        data.truth.sample,
        data.truth.track,
        data.truth.label,
        data.truth.centre_m + np.outer(data.truth.sample, [1.0, 0.0, 0.0]),
        data.truth.score,
        data.truth.num_points,
    )
    np.testing.assert_allclose(truth_speeds(Prepared(data.samples, moving, data.tracks)), 2.0)

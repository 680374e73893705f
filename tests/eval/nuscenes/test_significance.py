"""The fast bootstrap equals the exact one; paired comparison sees what single intervals do not."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from mottrack.core.errors import InputError
from mottrack.eval.nuscenes.bootstrap import (
    compare,
    difference,
    draw,
    evaluate_weighted,
    figures_of,
    interval,
    intervals,
    profiles,
    resampled,
)
from mottrack.eval.nuscenes.boxes import BoxTable, GroundTruth
from mottrack.eval.nuscenes.prepare import prepare
from mottrack.eval.nuscenes.rules import Rules
from mottrack.eval.nuscenes.summary import evaluate_prepared

Maker = Callable[..., tuple[GroundTruth, BoxTable]]
RULES = Rules()
COUNTS = ("gt", "tp", "fp", "fn", "ids", "frag", "mt", "ml")


@pytest.mark.parametrize("seed", range(5))
def test_counters_of_scenes_give_what_a_new_evaluation_gives(
    make_problem: Maker, seed: int
) -> None:
    data = prepare(*make_problem(seed, scenes=5), RULES)
    classes = profiles(data, RULES)
    weights = np.vstack([np.ones(5, np.int64), draw(5, 6, seed)])
    for weight in weights:
        fast = evaluate_weighted(classes, weight, RULES)
        exact = evaluate_prepared(resampled(data, weight), RULES)
        for label, figures in figures_of(exact).items():
            for name, value in figures.items():
                ours = figures_of(fast)[label][name]
                tolerance = 0.0 if name in COUNTS and label != "all" else 1e-9
                assert ours == pytest.approx(value, abs=tolerance, rel=0, nan_ok=True), (
                    label,
                    name,
                )


def test_intervals_hold_the_figure_and_draws_are_repeatable(make_problem: Maker) -> None:
    data = prepare(*make_problem(1, scenes=6), RULES)
    table = intervals(profiles(data, RULES), draw(6, 60), RULES)
    item = table["all"]["amota"]
    assert item.low <= item.value <= item.high
    assert item.low < item.high
    np.testing.assert_array_equal(draw(6, 4, seed=7), draw(6, 4, seed=7))
    assert (draw(6, 4).sum(axis=1) == 6).all()
    with pytest.raises(InputError, match="resamples"):
        draw(6, 0)
    with pytest.raises(InputError, match="scenes is 0"):
        draw(0, 6)


def test_comparison_is_paired(make_problem: Maker) -> None:
    truth, tracks = make_problem(2, scenes=8)
    worse = replace(tracks, centre_m=tracks.centre_m + np.array([1.2, 0.0, 0.0]))
    sides = [profiles(prepare(truth, side, RULES), RULES) for side in (worse, tracks)]
    weights = draw(8, 60)
    table = compare((sides[0], sides[1]), weights, RULES)
    same = compare((sides[1], sides[1]), weights, RULES)
    assert table["all"]["amota"].probability_better > 0.9
    assert table["all"]["amota"].interval.value > 0
    assert table["all"]["fn"].probability_better > 0.9
    assert same["all"]["amota"].probability_better == 0.5
    assert same["all"]["amota"].interval.high == 0.0


def test_undefined_resamples_are_counted_and_lower_can_be_better() -> None:
    item = interval(0.5, np.array([0.2, np.nan, 0.8]), 0.9)
    assert item.undefined == 1 and item.low == pytest.approx(0.23)
    assert difference(
        "amotp", -0.1, np.array([-0.2, -0.1, 0.3])
    ).probability_better == pytest.approx(2 / 3)

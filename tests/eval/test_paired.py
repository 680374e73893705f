"""Intervals of paired differences: closed forms and coverage."""

import numpy as np
import pytest
from scipy.stats import t as student_t

from mottrack.core.errors import InputError
from mottrack.eval.paired import (
    MetricKey,
    Pooled,
    Ratio,
    Sum,
    TailMean,
    draw,
    paired,
    sample,
    t_interval,
    variance,
)

KEY = MetricKey("velocity", "all", "mean", "m/s")


def _difference(a: np.ndarray, b: np.ndarray, resamples: int = 2000):
    weights = draw(len(a), resamples)
    ones = np.ones(len(a))
    sides = [sample(Ratio(side, ones), weights) for side in (a, b)]
    return paired(KEY, *sides)


@pytest.mark.parametrize("scenes", [3, 8, 40])
def test_the_interval_of_a_mean_is_the_textbook_t_interval(scenes: int) -> None:
    rng = np.random.default_rng(scenes)
    a, b = rng.normal(2.0, 1.0, (2, scenes))
    found = _difference(a, b, resamples=20_000)
    change = b - a
    reach = student_t.ppf(0.975, scenes - 1) * change.std(ddof=1) / np.sqrt(scenes)
    assert found.difference == pytest.approx(change.mean())
    assert found.high - found.difference == pytest.approx(reach, rel=0.03)
    assert found.difference - found.low == pytest.approx(reach, rel=0.03)


def test_95_percent_of_the_intervals_cover_the_true_difference_even_with_five_scenes() -> None:
    rng = np.random.default_rng(1)
    weights = draw(5, 200)
    covered = 0
    for _ in range(600):
        count = rng.integers(20, 60, 5).astype(float)
        hard = rng.normal(3.0, 1.0, 5)  # what is difficult for both runs cancels
        sides = [
            sample(Ratio(count * (hard + shift + rng.normal(0, 0.3, 5)), count), weights)
            for shift in (0.0, 0.2)
        ]
        found = paired(KEY, *sides)
        covered += found.low <= 0.2 <= found.high
    assert 0.92 <= covered / 600 <= 0.98


def test_equal_runs_do_not_differ_and_one_scene_has_no_interval() -> None:
    a = np.array([1.0, 2.0, 4.0])
    same = _difference(a, a)
    assert (same.low, same.high, same.significant, same.better) == (0.0, 0.0, False, None)
    constant = _difference(a, a - 1.0)
    assert constant.significant
    assert constant.better
    alone = _difference(a[:1], a[:1] - 1.0)
    assert np.isnan([alone.low, alone.high]).all()
    assert alone.better is None
    assert alone.scenes == 1


def test_only_scenes_with_data_count() -> None:
    weights = draw(4, 300)
    empty = Ratio(np.array([3.0, 0, 0, 0]), np.array([2.0, 0, 0, 0]))
    found = paired(KEY, sample(empty, weights), sample(empty, weights))
    assert found.scenes == 1
    assert np.isnan(found.low)


def test_every_metric_of_a_resample_is_that_of_the_copied_scenes() -> None:
    rng = np.random.default_rng(5)
    parts = [rng.exponential(1.0, n) for n in (30, 0, 7, 55)]
    weights = draw(4, 60)
    total, count = (np.array([f(p) for p in parts], float) for f in (np.sum, len))
    squares = np.array([(p**2).sum() for p in parts])
    figures = {
        "mean": Ratio(total, count),
        "rms": Ratio(squares, count, root=True),
        "variance": Pooled(variance, (total, squares, count)),
        "worst": TailMean.of(parts),
        "sum": Sum(total),
    }
    drawn = {name: figure.values(weights) for name, figure in figures.items()}
    for b, weight in enumerate(weights):
        copied = np.concatenate([np.tile(p, w) for p, w in zip(parts, weight, strict=True)])
        if not len(copied):
            assert np.isnan(drawn["mean"][b])
            continue
        assert drawn["mean"][b] == pytest.approx(copied.mean())
        assert drawn["rms"][b] == pytest.approx(np.sqrt((copied**2).mean()))
        assert drawn["variance"][b] == pytest.approx(copied.var())
        tail = np.sort(copied)[-max(1, round(0.05 * len(copied))) :]
        assert drawn["worst"][b] == pytest.approx(tail.mean())
        assert drawn["sum"][b] == pytest.approx(copied.sum())


def test_draws_are_repeatable_and_refuse_nothing_to_draw() -> None:
    np.testing.assert_array_equal(draw(6, 4, seed=7), draw(6, 4, seed=7))
    assert (draw(6, 4).sum(axis=1) == 6).all()
    with pytest.raises(InputError, match="resamples"):
        draw(6, 0)
    with pytest.raises(InputError, match="scenes is 0"):
        draw(0, 6)


def test_lower_or_higher_is_better_by_the_metric() -> None:
    higher = MetricKey("tracking", "all", "AMOTA", lower_is_better=False)
    weights = draw(6, 300)
    rng = np.random.default_rng(0)
    base = rng.random(6)
    a, b = (sample(Ratio(base + s + 0.01 * rng.random(6), np.ones(6)), weights) for s in (0, 1))
    assert paired(higher, a, b).better is True
    assert paired(KEY, a, b).better is False


def test_an_undefined_metric_has_no_interval() -> None:
    low, high = t_interval(float("nan"), np.full(10, np.nan), 5)
    assert np.isnan([low, high]).all()

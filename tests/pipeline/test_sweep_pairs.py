import numpy as np
import pytest

from mottrack.core import InputError, Pose, Sweep
from mottrack.core.sweep import SECOND_NS, median_period_s, seconds_between
from mottrack.pipeline.sweep_pairs import PairConfig, SweepPairs


def sweep_at(seconds: float) -> Sweep:
    return Sweep(np.zeros((0, 3)), np.zeros(0), round(seconds * SECOND_NS), Pose.identity())


def past_ages(times_s: list[float], config: PairConfig) -> list[list[float]]:
    """Ages of the past of each sweep, the newest first."""
    pairs = SweepPairs(config)
    ages: list[list[float]] = []
    for t in times_s:
        sweep = sweep_at(t)
        past = pairs.push(sweep)
        found = [round(seconds_between(p.stamp_ns, sweep.stamp_ns), 3) for p in past]
        assert found == sorted(found, reverse=True)
        ages.append(found[::-1])
    return ages


def partner_ages(times_s: list[float], *, consecutive: bool = False) -> list[float | None]:
    config = PairConfig(0.1, 0.3, 0.5, consecutive=consecutive)
    return [ages[0] if ages else None for ages in past_ages(times_s, config)]


def test_at_20_hz_the_sweep_before_the_last_is_the_partner() -> None:
    assert partner_ages([0, 0.05, 0.1, 0.15, 0.2]) == [None, 0.05, 0.1, 0.1, 0.1]


def test_a_filter_gets_consecutive_sweeps() -> None:
    assert partner_ages([0, 0.05, 0.1, 0.15], consecutive=True) == [None, 0.05, 0.05, 0.05]


def test_after_a_gap_there_is_no_pair_and_then_there_is_again() -> None:
    assert partner_ages([0, 0.1, 3.0, 3.1]) == [None, 0.1, None, 0.1]


@pytest.mark.parametrize("period_s", [0.05, 0.1])
def test_several_past_sweeps_reach_back_evenly(period_s: float) -> None:
    times_s = [k * period_s for k in range(30)]
    ages = past_ages(times_s, PairConfig(0.1, 0.3, 0.5, past_sweeps=5))
    assert ages[-1] == [0.1, 0.2, 0.3, 0.4, 0.5]
    assert ages[0] == []
    assert all(found == ages[-1][: len(found)] for found in ages[2:])


def test_with_fewer_sweeps_than_are_wanted_each_is_given_once() -> None:
    """A recording of 5 Hz, and one that lost a sweep."""
    config = PairConfig(0.1, 0.3, 0.5, past_sweeps=5)
    assert past_ages([0, 0.2, 0.4, 0.6, 0.8], config)[-1] == [0.2, 0.4]
    assert past_ages([0, 0.1, 0.2, 0.3, 0.5], config)[-1] == [0.2, 0.3, 0.4, 0.5]


def test_two_sweeps_are_enough_where_no_history_is_wanted() -> None:
    times_s = [0.1 * k for k in range(9)]
    for config in (PairConfig(0.1, 0.3, 0.5), PairConfig(0.1, 0.3, 0.1, past_sweeps=5)):
        assert past_ages(times_s, config)[-1] == [0.1]


def test_a_history_starts_anew_after_a_gap() -> None:
    """Sweeps before it are near enough to be chosen, none is near enough to be a partner."""
    config = PairConfig(0.1, 0.2, 0.5, past_sweeps=3)
    assert past_ages([0, 0.1, 0.2, 0.3, 0.6, 0.7], config)[4:] == [[], [0.1, 0.5]]


def test_a_scene_of_key_frames_alone_is_refused_with_the_reason() -> None:
    with pytest.raises(InputError, match=r"0.50 s.*read the sweeps between them"):
        partner_ages([0, 0.5, 1.0, 1.5])


def test_the_period_is_the_median_and_has_a_default() -> None:
    assert median_period_s([0, 10**8, 2 * 10**8, 9 * 10**8], default_s=1.0) == pytest.approx(0.1)
    assert median_period_s([5], default_s=0.25) == 0.25

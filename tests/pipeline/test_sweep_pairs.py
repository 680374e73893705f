import numpy as np
import pytest

from mottrack.core import InputError, Pose, Sweep
from mottrack.core.sweep import SECOND_NS, median_period_s, seconds_between
from mottrack.pipeline.sweep_pairs import SweepPairs


def sweep_at(seconds: float) -> Sweep:
    return Sweep(np.zeros((0, 3)), np.zeros(0), round(seconds * SECOND_NS), Pose.identity())


def partner_ages(times_s: list[float], *, consecutive: bool = False) -> list[float | None]:
    pairs = SweepPairs(0.1, 0.3)
    ages: list[float | None] = []
    for t in times_s:
        sweep = sweep_at(t)
        partner = pairs.push(sweep, consecutive=consecutive)
        ages.append(
            None if partner is None else round(seconds_between(partner.stamp_ns, sweep.stamp_ns), 3)
        )
    return ages


def test_at_20_hz_the_sweep_before_the_last_is_the_partner() -> None:
    assert partner_ages([0, 0.05, 0.1, 0.15, 0.2]) == [None, 0.05, 0.1, 0.1, 0.1]


def test_a_filter_gets_consecutive_sweeps() -> None:
    assert partner_ages([0, 0.05, 0.1, 0.15], consecutive=True) == [None, 0.05, 0.05, 0.05]


def test_after_a_gap_there_is_no_pair_and_then_there_is_again() -> None:
    assert partner_ages([0, 0.1, 3.0, 3.1]) == [None, 0.1, None, 0.1]


def test_a_scene_of_key_frames_alone_is_refused_with_the_reason() -> None:
    with pytest.raises(InputError, match="read the sweeps between them"):
        partner_ages([0, 0.5, 1.0, 1.5])


def test_the_period_is_the_median_and_has_a_default() -> None:
    assert median_period_s([0, 10**8, 2 * 10**8, 9 * 10**8], default_s=1.0) == pytest.approx(0.1)
    assert median_period_s([5], default_s=0.25) == 0.25

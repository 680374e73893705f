"""The latency report: percentiles, budget, warm-up and bottleneck of known times."""

import time

import numpy as np
import pytest

from mottrack.core import InputError
from mottrack.core.timing import timed
from mottrack.pipeline.latency import LatencyLog, Stopwatch


def test_percentiles_budget_and_bottleneck_of_known_times() -> None:
    log = LatencyLog(rate_hz=10)
    log.add({"flow": 9.0, "tracker": 1.0, "total": 10.0})  # loads and compiles
    for k in range(1, 101):
        flow_s = 0.2 if k > 95 else 0.001 * k / 2
        log.add({"flow": flow_s, "tracker": 0.03, "total": flow_s + 0.031})
    report = log.report()
    flow = report.stages["flow"]
    expected = np.array([0.5 * k for k in range(1, 96)] + [200.0] * 5)
    assert (flow.steps, flow.max_ms) == (100, 200.0)
    assert flow.mean_ms == pytest.approx(expected.mean())
    assert flow.p50_ms == pytest.approx(np.percentile(expected, 50))
    assert flow.p99_ms == pytest.approx(200.0)
    assert report.warm_up_ms == {"flow": 9000.0, "tracker": 1000.0, "total": 10_000.0}
    assert (report.steps, report.over_budget, report.over_budget_share) == (100, 5, 0.05)
    assert report.bottleneck is not None
    assert report.bottleneck.stage == "flow"
    assert report.bottleneck.share == pytest.approx(0.2 / 0.231)
    assert "5 of 100 steps over it (5.0%); most time in flow (87%)" in str(report)


def test_the_first_run_of_a_stage_counts_as_warm_up() -> None:
    log = LatencyLog(rate_hz=10)
    log.add({"tracker": 0.5, "total": 0.5})
    log.add({"tracker": 0.01, "total": 0.01})
    log.add({"flow": 5.0, "flow.ground": 4.0, "tracker": 0.01, "total": 5.01})
    log.add({"flow": 0.02, "flow.ground": 0.01, "tracker": 0.01, "total": 0.03})
    report = log.report()
    assert list(report.stages) == ["flow", "flow.ground", "tracker", "total"]
    # the second step had no flow: it would make the whole look faster than it is
    assert (report.steps, report.stages["tracker"].steps) == (1, 1)
    assert report.stages["total"].max_ms == pytest.approx(30.0)
    assert report.over_budget == 0


def test_only_the_last_steps_are_kept() -> None:
    log = LatencyLog(rate_hz=10, window=3)
    for seconds in (1.0, 9.0, 1e-3, 2e-3, 3e-3):
        log.add({"tracker": seconds, "total": seconds})
    assert log.report().stages["tracker"].max_ms == pytest.approx(3.0)


def test_a_report_before_the_first_step() -> None:
    assert "no step yet" in str(LatencyLog(rate_hz=20).report())


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, float("nan")])
def test_a_rate_that_is_not_positive_is_refused(rate_hz: float) -> None:
    with pytest.raises(InputError, match="rate_hz"):
        LatencyLog(rate_hz)


def test_a_part_is_timed_only_inside_the_stage_that_calls_it() -> None:
    @timed("ground")
    def ground() -> int:
        time.sleep(0.002)
        return 7

    watch = Stopwatch()
    with watch("flow"):
        assert ground() == 7
    assert ground() == 7  # no collector
    with watch("objects"):
        time.sleep(0.001)
    lap = watch.lap()
    assert list(lap) == ["flow.ground", "flow", "objects"]
    assert 0.002 <= lap["flow.ground"] <= lap["flow"]
    assert watch.lap() == {}
    watch.next_frame()
    assert set(watch.seconds()) == {"flow", "objects"}

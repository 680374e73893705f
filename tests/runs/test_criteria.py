"""Criteria that stand in an experiment's file, and the verdicts of its runs on them."""

from dataclasses import replace
from typing import Any

import pytest

from mottrack.core import ConfigError
from mottrack.eval.paired import PairedDifference
from mottrack.eval.velocity_value import Value
from mottrack.experiment.criteria import Criterion
from mottrack.experiment.experiment import load_experiments
from mottrack.runs.criteria import Verdict, judge, unmet
from mottrack.runs.velocity_bench import VELOCITY, FlowValue, metric_key

NAN = float("nan")


def criterion(**changes: Any) -> Criterion:
    plain = {
        "claim": "half of the gain",
        "run": "pillarflow",
        "metric": "velocity error",
        "measure": "share of headroom",
        "at_least": 0.5,
    }
    return Criterion(**plain | changes)


def value(low: float, high: float) -> FlowValue:
    middle = (low + high) / 2
    share = Value("velocity error", middle, low, high)
    slow = metric_key("velocity error", "slow")
    row = PairedDifference(slow, 1.0, 1.0 + middle, low, high, 9)
    return FlowValue("pillarflow", "zero", False, (row,), (share,), {VELOCITY: share})


SHARE = criterion()
SLOWER = criterion(measure="difference", objects="slow", at_least=None, at_most=0.0)
CHANGE = criterion(measure="relative change", at_least=None, at_most=-0.35)


@pytest.mark.parametrize(
    ("asked", "low", "high", "verdict"),
    [
        (SHARE, 0.51, 0.9, "met"),
        (SHARE, 0.2, 0.64, "undecided"),
        (SHARE, 0.1, 0.49, "failed"),
        (SHARE, NAN, NAN, "undecided"),
        (SLOWER, -0.2, -0.1, "met"),
        (SLOWER, 0.004, 0.062, "failed"),
        (CHANGE, -0.5, -0.36, "met"),
        (CHANGE, -0.5, -0.2, "undecided"),
        (criterion(metric="AMOTA"), 0.6, 0.7, "not measured"),
        (criterion(run="icp"), 0.6, 0.7, "not measured"),
    ],
)
def test_the_interval_decides(asked: Criterion, low: float, high: float, verdict: Verdict) -> None:
    (judged,) = judge([asked], [value(low, high)])
    assert judged.verdict == verdict
    assert asked.claim in judged.text
    assert len(list(unmet([judged]))) == 1 + (verdict != "met")


@pytest.mark.parametrize(
    ("asked", "reason"),
    [
        (criterion(run="icp"), "no run icp beside one without flow; there are: pillarflow"),
        (criterion(metric="AMOTA"), "no run with the true flow, or its gain is not significant"),
        (criterion(metric="AMOTA", measure="difference"), "pillarflow or zero has no AMOTA"),
    ],
)
def test_what_is_not_measured_has_its_reason(asked: Criterion, reason: str) -> None:
    (judged,) = judge([asked], [value(0.6, 0.7)])
    assert judged.verdict == "not measured"
    assert reason in judged.text


def test_what_failed_is_told_first() -> None:
    judged = judge([criterion(claim="a"), criterion(claim="b", at_least=0.1)], [value(0.0, 0.4)])
    lines = list(unmet([*judged, replace(judged[0], verdict="met")]))
    assert lines[0] == "Criteria written before the run: 1 of 3 met."
    assert [line.split()[0] for line in lines[1:]] == ["failed:", "undecided:"]
    assert "at least 50%, found 20% [0%, 40%]" in lines[1]


def test_criteria_belong_to_the_configuration() -> None:
    """Changed ones are those of another run: the bound can't be moved after the result."""
    first, second = (
        load_experiments("demo", [f"criteria=[{{claim: a, run: icp, metric: AMOTA, {rest}}}]"])[0]
        for rest in ("measure: difference, at_least: 0", "measure: difference, at_least: 0.1")
    )
    assert first.hash != second.hash
    with pytest.raises(ConfigError, match="one of at_least and at_most"):
        load_experiments(
            "demo", ["criteria=[{claim: a, run: b, metric: AMOTA, measure: difference}]"]
        )

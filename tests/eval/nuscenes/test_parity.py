"""Every value of six recorded evaluations by nuscenes-devkit 1.2.0."""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from mottrack.eval.nuscenes import command
from mottrack.eval.nuscenes.outputs import details_json, summary_json
from mottrack.eval.nuscenes.rules import Rules

COUNTS = {"gt", "tp", "fp", "fn", "ids", "frag", "mt", "ml"}
SETS = (
    "base_s11_n3",
    "base_s12_n5",
    "crowd_s15_n2",
    "edge_s14_n3",
    "perfect_s16_n2",
    "ties_s13_n2",
)


def assert_same(ours: Any, official: Any, where: str, tolerance: float) -> None:
    if isinstance(official, dict):
        for key, value in official.items():
            assert_same(ours[key], value, f"{where}.{key}", tolerance)
    elif isinstance(official, list):
        assert len(ours) == len(official), where
        for k, value in enumerate(official):
            assert_same(ours[k], value, f"{where}[{k}]", tolerance)
    elif isinstance(official, float) and math.isnan(official):
        assert math.isnan(ours), where
    elif isinstance(official, int | float):
        exact = any(f".{name}." in f"{where}." or f".{name}[" in where for name in COUNTS)
        assert ours == (official if exact else pytest.approx(official, abs=tolerance, rel=0)), where
    else:
        assert ours == official, where


@pytest.mark.parametrize("name", SETS)
def test_every_value_equals_the_official_one(golden: dict[str, Any], name: str) -> None:
    case = golden[name]
    request = command.Request(
        case.data, "v1.0-trainval", str(case.scenes), case.data / "submission.json"
    )
    evaluation = command.run(request)
    meta = evaluation.meta
    summary = json.loads((case.official / "metrics_summary.json").read_text())
    details = json.loads((case.official / "metrics_details.json").read_text())
    summary.pop("eval_time")
    ours = summary_json(evaluation.metrics, meta, evaluation.eval_time_s)
    assert set(ours) - set(summary) == {"eval_time", "interpolation"}
    assert_same(ours, summary, "summary", 1e-12)
    assert_same(details_json(evaluation.metrics), details, "details", 1e-12)


def test_right_interpolation_is_a_switch_and_is_named(
    golden: dict[str, Any], tmp_path: Path
) -> None:
    case = golden["base_s11_n3"]
    results = {}
    for choice in ("official", "fixed"):
        request = command.Request(
            case.data,
            "v1.0-trainval",
            str(case.scenes),
            case.data / "submission.json",
            Rules(interpolation=choice),  # type: ignore[arg-type]
        )
        evaluation = command.run(request)
        command.write(evaluation, tmp_path / choice)
        results[choice] = evaluation.metrics.total["amota"]
        for path in (tmp_path / choice).iterdir():
            assert choice in path.read_text(), path
    assert results["fixed"] > results["official"]
    strict = (tmp_path / "fixed/metrics_details.strict.json").read_text()
    json.loads(strict, parse_constant=lambda text: pytest.fail(f"{text} is not JSON"))

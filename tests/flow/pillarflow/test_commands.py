"""``mottrack train``, ``calibrate`` and ``export`` from end to end, at the smallest size."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from mottrack.cli import app
from mottrack.core.errors import ConfigError
from mottrack.flow.pillarflow.training.config import ExamplesConfig
from mottrack.studies.example_sets import ExampleSet

TINY = """
network: small
examples: {pairs: 2, validation_pairs: 2, per_shard: 2}
steps: 2
batch_size: 1
threads: 1
log_every: 1
"""


def test_train_makes_examples_trains_and_resumes(tmp_path: Path) -> None:
    config = tmp_path / "tiny.yaml"
    config.write_text(TINY)
    out, examples = tmp_path / "run", tmp_path / "examples"
    arguments = ["train", str(config), "--out", str(out), "--examples", str(examples)]
    first = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert first.exit_code == 0
    assert "dynamic_rmse" in first.output
    again = CliRunner().invoke(app, [*arguments, "steps=3"], catch_exceptions=False)
    assert again.exit_code == 0
    curve = json.loads((out / "curve.json").read_text())
    assert [point["step"] for point in curve if "loss" in point] == [1.0, 2.0, 3.0]
    assert (out / "curve.png").exists()
    weights = out / "weights.safetensors"
    asked = ["calibrate", str(weights), "--pairs", "2"]
    calibrated = CliRunner().invoke(app, asked, catch_exceptions=False)
    assert "inside_2_sigma" in calibrated.output


def test_export_reports_the_difference_to_onnxruntime(tmp_path: Path) -> None:
    file = tmp_path / "small.onnx"
    asked = ["export", "small", "--out", str(file)]
    exported = CliRunner().invoke(app, asked, catch_exceptions=False)
    assert exported.exit_code == 0
    worst_m = float(exported.output.split("at most ")[1].split()[0])
    assert worst_m < 1e-3
    assert file.stat().st_size > 500_000


@pytest.mark.parametrize("override", ["network_name=base", "steps=0", "steps=1,2"])
def test_an_unusable_setting_is_named(tmp_path: Path, override: str) -> None:
    config = tmp_path / "tiny.yaml"
    config.write_text(TINY)
    key = override.partition("=")[0]
    with pytest.raises(ConfigError, match=key):
        CliRunner().invoke(
            app, ["train", str(config), override, "--out", str(tmp_path)], catch_exceptions=False
        )


def test_each_set_of_examples_has_a_folder_of_its_own(tmp_path: Path) -> None:
    one, two = ExamplesConfig(seed=1), ExamplesConfig(seed=2)
    folders = [ExampleSet.within(tmp_path, config).path for config in (one, two)]
    assert folders[0] != folders[1]
    assert ExampleSet.within(tmp_path, ExamplesConfig(seed=1)).path == folders[0]

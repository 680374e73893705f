"""`mottrack estimate-noise` on a real sequence: what it writes is a tracker that runs."""

from pathlib import Path

import yaml
from typer.testing import CliRunner

from mottrack.cli import app
from mottrack.core.objects import Objects
from mottrack.trackers import KalmanTracker

EXPERIMENT = """
dataset: {{kind: kitti, root: {root}}}
scenes: ["0000"]
flow: zero
tracker: kalman
"""


def test_the_result_plugs_into_a_config(shared_data: Path, tmp_path: Path) -> None:
    experiment = tmp_path / "experiment.yaml"
    experiment.write_text(EXPERIMENT.format(root=shared_data / "kitti_tracking"))
    out = tmp_path / "tracker" / "learned.yaml"
    done = CliRunner().invoke(app, ["estimate-noise", str(experiment), "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert "NEES" in done.output
    settings = yaml.safe_load(out.read_text())
    assert settings.pop("kind") == "kalman"
    config = KalmanTracker.Config.model_validate(settings)
    learned = config.noise.classes["car"]
    assert 0.001 < learned.observation[0] < 0.25
    assert len(KalmanTracker(config).step(0, Objects.empty(0))) == 0

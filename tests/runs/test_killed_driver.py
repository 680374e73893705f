"""``kill -9`` of the driver, and the same command again."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

from mottrack.experiment.experiment import load_experiments
from mottrack.runs.local_pool import LocalPool
from mottrack.runs.run_folder import RunFolder
from mottrack.runs.runner import Execution, run_experiment

PLUGINS = Path(__file__).resolve().parents[1] / "plugins"
SCENES = [f"s{k}" for k in range(8)]
MOST_S = 120.0  # until the first two scenes have ended, on a busy machine too


def started(config: Path, out: Path, where: list[str]) -> subprocess.Popen[bytes]:
    own = [str(PLUGINS.parents[1]), str(PLUGINS), *os.environ.get("PYTHONPATH", "").split(":")]
    command = [sys.executable, "-m", "mottrack", "run", str(config), "--out", str(out), *where]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, own))}
    return subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL)


@pytest.mark.parametrize("executor", ["local", "ray"])
def test_a_killed_driver_is_resumed_with_the_same_bytes(
    executor: str, tmp_path: Path, progress: object, request: pytest.FixtureRequest
) -> None:
    where = ["--workers", "2"]
    if executor == "ray":
        where = ["--cluster", request.getfixturevalue("cluster").address]
    tree = {
        "dataset": {"kind": "toy_plugins:ToyDataset", "scenes": SCENES, "frames": 25},
        "flow": {"kind": "toy_plugins:ConstantFlow"},
        "tracker": {"kind": "toy_plugins:EchoTracker"},
    }
    config = tmp_path / "toys.yaml"
    config.write_text(yaml.safe_dump(tree))
    (experiment,) = load_experiments(str(config))
    whole, killed = RunFolder(tmp_path / "whole"), RunFolder(tmp_path / "killed")
    local = Execution(LocalPool(2))
    run_experiment(experiment, whole, execution=local, progress=progress)
    driver, end = started(config, killed.path, where), time.monotonic() + MOST_S
    while len(killed.scenes) < 2 and driver.poll() is None and time.monotonic() < end:
        time.sleep(0.01)
    driver.send_signal(signal.SIGKILL)
    assert driver.wait() == -signal.SIGKILL
    resumed = len(killed.scenes)
    assert 2 <= resumed < len(SCENES)
    again = started(config, killed.path, where)
    assert again.wait(MOST_S) == 0
    assert killed.scenes == whole.scenes
    for scene in SCENES:
        assert killed.scene_file(scene).read_bytes() == whole.scene_file(scene).read_bytes()
    assert not list(killed.path.rglob("*.part"))

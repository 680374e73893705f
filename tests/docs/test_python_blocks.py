"""Every Python block of the README and of the documentation runs unchanged."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mottrack import Pose, Sweep
from mottrack.experiment.experiment import load_to_stream
from mottrack.pipeline.scene_run import run_scene

from .conftest import REPOSITORY, TEXTS, blocks, names

WITH_PYTHON = [file for file in TEXTS if blocks(file, "python")]


def test_there_are_blocks_to_run() -> None:
    assert {"README.md", "docs/streaming.md", "docs/quick_start.md"} <= set(names(WITH_PYTHON))


@pytest.mark.parametrize("text", names(WITH_PYTHON))
def test_python_blocks_of(text: str, monkeypatch: pytest.MonkeyPatch, stored_run: Path) -> None:
    monkeypatch.chdir(stored_run)
    namespace: dict[str, Any] = predefined_names()
    for number, code in enumerate(blocks(REPOSITORY / text, "python"), 1):
        exec(compile(code, f"{text}, block {number}", "exec"), namespace)  # noqa: S102


@pytest.fixture(scope="module")
def stored_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the first run of the quick start."""
    folder = tmp_path_factory.mktemp("reader")
    small = ["flow=zero", "score_flow=false", "dataset.scenes=1", "dataset.duration_s=1"]
    experiment = load_to_stream("demo", small)
    dataset = experiment.dataset.make()
    run = run_scene(experiment, dataset.scene("synthetic-s1000-0000"), keep_snapshots=False)
    path = folder / "out" / "first" / "scenes" / "synthetic-s1000-0000.npz"
    path.parent.mkdir(parents=True)
    run.result.save(path)
    return folder


def predefined_names() -> dict[str, Any]:
    """Return the names that a text may use without defining them: detections, sweeps."""
    return {
        "detections": [(k * 10**8, boxes(float(k))) for k in range(5)],
        "lidar": [cloud(0.5 * k) for k in range(4)],
        "previous": sweep(0.0, 0),
        "current": sweep(1.0, 10**8),
    }


def boxes(x_m: float) -> SimpleNamespace:
    return SimpleNamespace(
        token=f"sample at {x_m} m",
        centre=np.array([[x_m, 0.0, 0.8]]),
        size=np.array([[4.5, 1.9, 1.6]]),
        yaw=np.zeros(1),
        label=np.array(["car"]),
        score=np.array([0.9]),
    )


def sweep(x_m: float, stamp_ns: int) -> Sweep:
    points = cloud(x_m)
    origin_m = np.array([0.0, 0.0, 1.8])
    return Sweep(points, np.zeros(len(points)), stamp_ns, Pose.identity(), origin_m)


def cloud(x_m: float) -> np.ndarray:
    """Return points of a car at x_m, 8 m to the left, on flat ground."""
    return np.concatenate(list(parts(x_m))).astype(np.float32)


def parts(x_m: float) -> Iterator[np.ndarray]:
    rng = np.random.default_rng(0)
    yield rng.uniform(-0.5, 0.5, (400, 3)) * [4.5, 1.9, 1.2] + [x_m, 8.0, 1.0]
    yield np.column_stack([rng.uniform(-40, 40, (8000, 2)), rng.normal(0, 0.01, 8000)])


def test_the_program_of_the_readme_prints_what_was_put_in(
    capsys: pytest.CaptureFixture[str],
) -> None:
    namespace: dict[str, Any] = {}
    (code,) = blocks(REPOSITORY / "README.md", "python")
    assert len([line for line in code.splitlines() if line.strip()]) <= 10
    exec(code, namespace)  # noqa: S102
    assert capsys.readouterr().out.startswith("[1 2]")
    np.testing.assert_allclose(namespace["tracks"].velocity_mps, [[8, 0], [0, 0]], atol=0.1)


def test_the_documented_data_set_fulfils_the_protocol() -> None:
    from mottrack import Pipeline
    from mottrack.core import Dataset, Scene

    namespace: dict[str, Any] = {}
    (code,) = blocks(REPOSITORY / "docs" / "own_logs.md", "python")
    exec(code, namespace)  # noqa: S102
    dataset = namespace["MyDataset"]()
    scene = dataset.scene(dataset.scene_names[0])
    assert isinstance(dataset, Dataset)
    assert isinstance(scene, Scene)
    pipeline = Pipeline.from_config("demo", "flow=zero")
    for index in range(3):
        step = pipeline.step(scene.frame(index), scene.sweep(index))
    assert step.field is not None

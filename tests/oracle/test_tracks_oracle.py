"""Tracks that `mottrack tracks` writes, read by the official tools as they are."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import pytest

from mottrack.core import Dataset, SceneResult
from mottrack.datasets.argoverse2 import results as argoverse2
from mottrack.datasets.argoverse2.config import Argoverse2Config
from mottrack.datasets.argoverse2.dataset import Argoverse2
from mottrack.datasets.nuscenes.config import NuScenesConfig
from mottrack.datasets.nuscenes.dataset import NuScenes
from mottrack.datasets.nuscenes.submission import write_submission
from mottrack.datasets.scene_frames import key_frames
from mottrack.datasets.synthetic import SyntheticConfig
from mottrack.datasets.writers import write_synthetic
from mottrack.eval.nuscenes.metrics import evaluate_prepared
from mottrack.eval.nuscenes.prepare import prepare_results
from mottrack.eval.nuscenes.rules import Rules
from mottrack.formats.nuscenes_classes import RACK_CATEGORY
from tests.runs.perfect import perfect

WORLD = SyntheticConfig(scenes=2, seed=5, duration_s=1.2)


def results_on(dataset: Dataset) -> list[SceneResult]:
    """Return what a tracker stores that returns the truth, a little beside it."""
    scenes = [dataset.scene(name) for name in dataset.scene_names]
    return [perfect(scene.name, list(key_frames(scene)), scene.classes) for scene in scenes]


def test_av2s_own_command_evaluates_an_argoverse_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every object has one identity and lies within centimetres: MOTA 1 and HOTA near 1."""
    from av2.evaluation.tracking.eval import evaluate

    # it writes its own tables into a folder beside the working one
    monkeypatch.chdir(tmp_path)
    write_synthetic(tmp_path / "data", "argoverse2", WORLD)
    dataset = Argoverse2(Argoverse2Config(root=tmp_path / "data"))
    argoverse2.write_tracks(tmp_path / "out", results_on(dataset))
    predictions, labels = (
        pickle.loads((tmp_path / f"out/{name}.pkl").read_bytes())  # noqa: S301 - made above
        for name in ("predictions", "ground_truth")
    )
    names = {str(name) for log in labels.values() for frame in log for name in frame["name"]}
    result, _, mean = evaluate(predictions, labels, "HOTA", 50, None, str(tmp_path / "av2/x.json"))
    assert "REGULAR_VEHICLE" in names
    assert mean["REGULAR_VEHICLE"] > 0.0
    scored = result["TrackEvalDataset"]["TRACKER"]["COMBINED_SEQ"]["REGULAR_VEHICLE"]
    assert scored["CLEAR"]["MOTA"] == pytest.approx(1.0)
    assert scored["CLEAR"]["IDSW"] == 0
    assert scored["HOTA"]["HOTA"].mean() > 0.9


def test_racks_count_as_in_the_devkit(tmp_path: Path) -> None:
    """On the rehearsal half of the motorcycles stand in a rack: a run's AMOTA is the official one.

    The tracks of every second motorcycle are left out, so that the figure tells which ones count.
    """
    from devkit_evaluation import evaluate_folder

    data = tmp_path / "data"
    names = write_synthetic(data, "nuscenes", WORLD.model_copy(update={"duration_s": 4.05}))
    (data / "scenes.txt").write_text("\n".join(names))
    results = [
        replace(
            r, tracks=r.tracks.select((r.tracks.label != "motorcycle") | (r.tracks.id % 2 == 0))
        )
        for r in results_on(NuScenes(NuScenesConfig(root=data, rate_hz=2)))
    ]
    write_submission(data / "submission.json", results)
    official, _ = evaluate_folder(data, tmp_path / "devkit")
    own = evaluate_prepared(prepare_results(results, Rules()), Rules())
    bare = [replace(r, truth=r.truth.select(r.truth.label != RACK_CATEGORY)) for r in results]
    without = evaluate_prepared(prepare_results(bare, Rules()), Rules())
    for label, figures in own.classes.items():
        for name in ("amota", "amotp", "gt"):
            assert figures[name] == pytest.approx(
                official["label_metrics"][name][label], nan_ok=True
            )
    found, apart = own.classes["motorcycle"], without.classes["motorcycle"]
    assert found["gt"] < apart["gt"]
    assert abs(found["amota"] - apart["amota"]) > 0.1


def test_the_devkit_loads_a_nuscenes_run(tmp_path: Path) -> None:
    from nuscenes.eval.common.config import config_factory
    from nuscenes.eval.common.loaders import load_prediction
    from nuscenes.eval.tracking.data_classes import TrackingBox

    config_factory("tracking_nips_2019")  # sets the names that the devkit knows
    write_synthetic(tmp_path / "data", "nuscenes", WORLD)
    results = results_on(NuScenes(NuScenesConfig(root=tmp_path / "data", rate_hz=2)))
    written = write_submission(tmp_path / "tracks.json", results)
    boxes, meta = load_prediction(str(tmp_path / "tracks.json"), 500, TrackingBox)
    assert len(boxes.all) == written
    assert meta["use_lidar"]
    assert len(boxes.sample_tokens) == sum(len(result.frames) for result in results)

"""Search for settings: ranges from the models, resuming, and figures of scenes left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from mottrack.core.errors import ConfigError, DataError, ResultError
from mottrack.experiment.experiment import Experiment, load_experiments
from mottrack.pipeline.scene_run import run_scene
from mottrack.studies.tuning.objectives import OBJECTIVES
from mottrack.studies.tuning.recorded import RecordedScene, record
from mottrack.studies.tuning.search import Search, claim, tune
from mottrack.studies.tuning.search_space import settings_of
from mottrack.studies.tuning.tables import found_table, gain_table, tracker_yaml
from mottrack.trackers import KalmanTracker

WANTED = [
    "association.gate=1..9",
    "track_management.p_detection",
    "association.method=greedy|hungarian",
]


@pytest.fixture(scope="module")
def experiment() -> Experiment:
    world = {"dataset.scenes": 3, "dataset.seed": 11, "dataset.duration_s": 2.0}
    changes = [f"{key}={value}" for key, value in world.items()]
    (one,) = load_experiments("demo", [*changes, "flow=zero", "score_flow=false"])
    return one


@pytest.fixture(scope="module")
def scenes(experiment: Experiment) -> list[RecordedScene]:
    return record(experiment)


def search(experiment: Experiment, trials: int) -> Search:
    settings = settings_of(experiment.tracker.config, WANTED)  # type: ignore[arg-type]
    return Search(experiment, tuple(settings), OBJECTIVES["velocity_error"], trials, seed=3)


def test_an_interrupted_search_finds_the_same(
    experiment: Experiment, scenes: list[RecordedScene], tmp_path: Path
) -> None:
    for folder in ("whole", "parts"):
        claim(search(experiment, 4), 2, tmp_path / folder)
    whole = tune(search(experiment, 4), scenes, 2, tmp_path / "whole", lambda *_: None)
    tune(search(experiment, 2), scenes, 2, tmp_path / "parts", lambda *_: None)
    resumed = tune(search(experiment, 4), scenes, 2, tmp_path / "parts", lambda *_: None)
    assert resumed == whole
    assert whole.held_out[0].key.metric == "velocity error"
    # the scenes of a fold are those that its search left out
    assert [fold.scenes for fold in whole.by_fold] == [
        (scenes[0].result.name, scenes[2].result.name),
        (scenes[1].result.name,),
    ]
    written = yaml.safe_load(tracker_yaml(search(experiment, 4), whole))
    assert written.pop("kind") == "kalman"
    assert KalmanTracker.Config(**written).association.gate == whole.best["association.gate"]
    assert len(gain_table(whole).rows) == len(whole.held_out)
    assert len(found_table(search(experiment, 4), whole).rows) == len(WANTED) + 1


def test_a_folder_of_another_search_is_refused(experiment: Experiment, tmp_path: Path) -> None:
    claim(search(experiment, 4), 2, tmp_path)
    claim(search(experiment, 60), 2, tmp_path)  # more trials of the same search
    with pytest.raises(ResultError, match="folds is 2, expected 3, as this command has it"):
        claim(search(experiment, 4), 3, tmp_path)
    with pytest.raises(ConfigError, match="--folds is 5, expected at most 3, one for each scene"):
        claim(search(experiment, 4), 5, tmp_path)
    (tmp_path / "search.json").write_text("{")
    with pytest.raises(DataError, match=r"search\.json"):
        claim(search(experiment, 4), 2, tmp_path)


def test_recorded_scenes_give_the_tracks_of_a_run(
    experiment: Experiment, scenes: list[RecordedScene]
) -> None:
    scene = experiment.dataset.make().scene(scenes[0].result.name)
    ran = run_scene(experiment, scene, keep_snapshots=False).result
    again = scenes[0].tracked(experiment.tracker)
    for table in ("tracks", "truth", "frames"):
        for column in type(getattr(ran, table)).COLUMNS:
            a, b = (getattr(getattr(result, table), column) for result in (ran, again))
            np.testing.assert_array_equal(a, b, err_msg=f"{table}.{column}")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("association.gat", "gate"),
        ("association.gate=5", "LOW..HIGH"),
        ("association.gate=9..1", "LOW below HIGH"),
        ("noise.classes", "give its range"),
        ("gate.x", "gate"),
        ("association.metric=near|far", "metric is 'near', expected: .*'mahalanobis'"),
        ("association.gate=-5..-1", "gate is -5.0, expected: .*greater than 0"),
        ("association=1..5", "association is 1.0, expected: .*a valid dictionary"),
    ],
)
def test_unusable_settings_are_named(text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        settings_of(KalmanTracker.Config(), [text])
    with pytest.raises(ConfigError, match="given twice"):
        settings_of(KalmanTracker.Config(), ["association.gate", "association.gate=1..2"])


def test_ranges_come_from_the_models() -> None:
    gate, iou, flag = settings_of(
        KalmanTracker.Config(), ["association.gate", "nms.iou", "nms.enabled"]
    )
    assert (gate.low, gate.high) == (1.25, 20.0)
    assert 0.0 < iou.low < 0.01
    assert 0.99 < iou.high < 1.0
    assert flag.choices == (False, True)

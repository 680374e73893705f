"""Search for settings: ranges from the models, resuming, and figures of scenes left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from mottrack.core.errors import ConfigError, ResultError
from mottrack.experiment.experiment import Experiment, load_experiments
from mottrack.pipeline.scene_run import run_scene
from mottrack.studies.tuning.objectives import OBJECTIVES
from mottrack.studies.tuning.recorded import RecordedScene, record
from mottrack.studies.tuning.search import Search, tune
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
    with pytest.raises(ResultError, match="another"):
        tune(search(experiment, 4), scenes, 3, tmp_path / "whole", lambda *_: None)


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
    ],
)
def test_unusable_settings_are_named(text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        settings_of(KalmanTracker.Config(), [text])


def test_ranges_come_from_the_models() -> None:
    gate, iou, flag = settings_of(
        KalmanTracker.Config(), ["association.gate", "nms.iou", "nms.enabled"]
    )
    assert (gate.low, gate.high) == (1.25, 20.0)
    assert 0.0 < iou.low < 0.01
    assert 0.99 < iou.high < 1.0
    assert flag.choices == (False, True)

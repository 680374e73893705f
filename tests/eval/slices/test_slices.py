"""Slices against the scores of the whole run, and against figures worked out by hand."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from mottrack.cli import app
from mottrack.core.errors import ConfigError, DataError
from mottrack.eval.evaluation import score
from mottrack.eval.occlusion import hidden_shares
from mottrack.eval.paired import draw
from mottrack.eval.scores import ScoreConfig
from mottrack.eval.slices.columns import binned
from mottrack.eval.slices.figures import MOTA, PRECISION, RECALL, VELOCITY, figure_key, slices
from mottrack.eval.slices.own_columns import read_own_columns
from mottrack.eval.tracked_scenes import TrackedScenes
from mottrack.experiment.experiment import load_experiments
from mottrack.pipeline.scene_run import run_scene

from .scenes import Box, scenes


@pytest.fixture(scope="module")
def driven() -> TrackedScenes:
    """Two short scenes of the embedded world, tracked."""
    settings = ["flow=zero", "tracker=kalman", "dataset.scenes=2", "dataset.duration_s=3"]
    experiment = load_experiments("demo", [*settings, "dataset.key_hz=5", "score_flow=false"])[0]
    dataset = experiment.dataset.make()
    runs = [run_scene(experiment, dataset.scene(name)) for name in dataset.scene_names]
    results = tuple(run.result for run in runs)
    from mottrack.core.scene_objects import SceneObjects

    objects = tuple(SceneObjects.stacked(run.objects) for run in runs)
    return TrackedScenes(results, ScoreConfig(), objects)


def values(tracked: TrackedScenes, *by: str) -> dict[tuple[str, str, str], float]:
    found = slices(tracked, by, draw(len(tracked.results), 20))
    return {
        (s.column, s.name, key.metric): sampled.value
        for s in found
        for key, sampled in s.figures.items()
    }


def test_slices_by_class_are_the_scores_of_the_classes(driven: TrackedScenes) -> None:
    whole = score(list(driven.results), driven.config)
    found = values(driven, "class")
    for label, scores in whole.classes.items():
        if scores.clear.truth:
            for name, value in ((RECALL, "recall"), (MOTA, "mota"), (PRECISION, "precision")):
                own = scores.as_dict()[value]
                if not np.isnan(own):
                    assert found["class", label, name] == pytest.approx(own, abs=1e-12)


@pytest.mark.parametrize("column", ["range", "speed", "points", "occlusion", "scene"])
def test_every_column_takes_all_boxes_apart(driven: TrackedScenes, column: str) -> None:
    """Boxes in slices add up to those of the classes, where the column says something of all."""
    weights = draw(2, 20)
    boxes = {c: sum(s.boxes for s in slices(driven, [c], weights)) for c in (column, "class")}
    assert boxes[column] == boxes["class"]


def test_ranges_and_velocity_errors_by_hand() -> None:
    truth = [Box(f, i, x, 0.0, speed=2.0) for f in range(4) for i, x in ((1, 5.0), (2, 25.0))]
    tracks = [Box(f, 7, 5.5, 0.0, speed=3.0) for f in range(4)] + [Box(0, 9, 28.5, 0.0)]
    found = values(scenes(truth, tracks), "range")
    assert found["range", "[0, 10) m", RECALL] == 1.0
    assert found["range", "[20, 30) m", RECALL] == 0.0
    assert found["range", "[20, 30) m", MOTA] == pytest.approx(1 - 5 / 4)
    assert found["range", "[0, 10) m", VELOCITY] == pytest.approx(1.0)


def test_a_box_behind_another_is_hidden() -> None:
    """Seen from the origin the box at 20 m is as wide as half of the one at 10 m."""
    truth = [Box(0, 1, 10.0, 0.0), Box(0, 2, 20.0, 0.0), Box(0, 3, 0.0, 10.0), Box(0, 4, 20.0, 2.0)]
    shares = hidden_shares(scenes(truth, []).results[0])
    assert shares[0, 1] == shares[0, 3] == 0.0
    assert shares[0, 2] == 1.0
    assert 0.3 < shares[0, 4] < 0.9


def test_own_columns_of_scenes_objects_and_boxes(tmp_path: Path) -> None:
    truth = [Box(f, i, 5.0 * i, 0.0) for f in range(4) for i in (1, 2)]
    tracked = scenes(truth, [Box(f, 7, 5.0, 0.0) for f in range(4)])
    path = tmp_path / "own.csv"
    path.write_text(
        "scene,id,frame,weather,colour\none,,,rain,\none,1,,,red\none,2,,,blue\none,2,0,,red\n"
    )
    found = values(read_own_columns(path).added_to(tracked), "weather", "colour")
    assert found["weather", "rain", RECALL] == 0.5
    assert found["weather", "rain", PRECISION] == 1.0
    assert found["colour", "red", RECALL] == pytest.approx(4 / 5)
    assert found["colour", "blue", RECALL] == 0.0
    assert ("colour", "red", PRECISION) not in found  # tracks have no colour
    many = tmp_path / "many.csv"
    many.write_text("scene,id,frame,width\n" + "".join(f"one,1,{f},{f}\n" for f in range(20)))
    names = {s for _, s, _ in values(read_own_columns(many).added_to(tracked), "width")}
    assert names == {"[-inf, 4.75)"}  # the quarter that frames 0 to 3 are in


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("id,weather\n1,rain\n", "header"),
        ("scene,weather\none\n", "line 2 is 1 cells, expected 2"),
        ("scene,id,weather\none,x,rain\n", "line 2, id is x"),
        ("scene,weather\nother,rain\n", "a scene such as one"),
    ],
)
def test_wrong_columns_are_refused(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "own.csv"
    path.write_text(text)
    with pytest.raises(DataError, match=message):
        read_own_columns(path).added_to(scenes([Box(0, 1, 5.0, 0.0)], []))


def test_an_unknown_column_names_the_known_ones() -> None:
    with pytest.raises(ConfigError, match="occlusion"):
        values(scenes([Box(0, 1, 5.0, 0.0)], []), "occlusoin")
    assert binned(np.array([np.nan]), (0.0, 1.0), "m").tolist() == [""]


def test_figures_of_files_by_the_labels_own_column(shared_data: Path, tmp_path: Path) -> None:
    """KITTI's own grade of occlusion; the boxes of a class are those of its labels."""
    labels = shared_data / "kitti_tracking/training/label_02"
    tracks = shared_data / "kitti_ab3dmot_reference/pointrcnn_Car_val"
    command = ["eval", "slices", "--labels", str(labels), "--tracks", str(tracks)]
    done = CliRunner().invoke(app, [*command, "--by", "occlusion", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    found = json.loads((tmp_path / "slices.json").read_text())["slices"]["pointrcnn_Car_val"]
    assert sum(row["true_boxes"] for row in found) == 9550  # every car of the split
    recall = {row["slice"]: row["recall"]["value"] for row in found}
    assert recall["visible"] > recall["largely"]


def test_keys_of_figures_say_which_way_is_better(driven: TrackedScenes) -> None:
    assert not figure_key("class", "car", RECALL).lower_is_better
    assert figure_key("class", "car", VELOCITY).lower_is_better
    unknown = replace(driven, velocities="none")
    assert not any(metric == VELOCITY for _, _, metric in values(unknown, "class"))


def test_a_submission_is_sliced_by_what_its_scenes_tell(tmp_path: Path) -> None:
    """Two scenes of the embedded world as nuScenes tables, detections as tracks, one at night."""
    from mottrack.datasets.synthetic import SyntheticConfig
    from mottrack.datasets.writers import write_synthetic

    write_synthetic(tmp_path, "nuscenes", SyntheticConfig(scenes=2, seed=5, duration_s=1.1))
    table = tmp_path / "v1.0-trainval/scene.json"
    rows = json.loads(table.read_text())
    for row, words in zip(rows, ("Night, rain", "A crossing"), strict=True):
        row["description"] = words
    table.write_text(json.dumps(rows))
    split = tmp_path / "split.txt"
    split.write_text("\n".join(row["name"] for row in rows))
    content = json.loads((tmp_path / "detections/synthetic.json").read_text())
    for boxes in content["results"].values():
        for number, box in enumerate(boxes):
            box["tracking_id"], box["tracking_name"] = str(number), box.pop("detection_name")
            box["tracking_score"], box["velocity"] = box.pop("detection_score"), [1.0, 0.0]
    submission = tmp_path / "tracks.json"
    submission.write_text(json.dumps(content))
    command = ["eval", "slices", "--dataroot", str(tmp_path), "--split", str(split)]
    command += ["--submission", str(submission), "--by", "light,weather"]
    done = CliRunner().invoke(app, [*command, "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    found = json.loads((tmp_path / "out/slices.json").read_text())["slices"]["tracks"]
    assert {row["slice"] for row in found} == {"night", "day", "rain", "dry"}
    assert all(row["precision"]["value"] > 0 for row in found)
    assert all(row["velocity error"]["value"] >= 0 for row in found)

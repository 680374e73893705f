"""The published AB3DMOT table and its logs, and the protocol's rules on small cases."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from mottrack.cli import app
from mottrack.core.errors import ConfigError, DataError
from mottrack.eval.kitti import files
from mottrack.eval.kitti.boxes import read_boxes
from mottrack.eval.kitti.levels import KittiMetrics, count, evaluate, thresholds
from mottrack.eval.kitti.matching import SPLITS, KittiRules, match, prepare

PUBLISHED = {
    "Car": "93.28 45.43 77.41 86.24 78.43 0 15 365 788",
    "Pedestrian": "74.39 29.77 53.90 69.50 67.77 1 74 276 2708",
    "Cyclist": "72.94 37.95 63.03 79.82 76.55 0 4 55 217",
}
NUMBER = r"(-?[\d.]+)"


def published_levels(log: Path) -> list[tuple[str, list[str]]]:
    """Threshold and the printed figures of every level of an official log."""
    head = rf"confidence threshold {NUMBER}, recall {NUMBER}=+\n.*\n(.*)\n"
    return [(f"{m[0]} {m[1]}", m[2].split()) for m in re.findall(head, log.read_text())]


def printed(metrics: KittiMetrics) -> list[tuple[str, list[str]]]:
    """Our levels as the official code prints them, FAR left out."""
    lines = []
    for level in metrics.levels:
        row = level.as_dict()
        f1 = 2 * row["precision"] * row["recall"] / max(row["precision"] + row["recall"], 1e-9)
        shares = [row[name] for name in ("smota", "mota", "motp", "mt", "ml")]
        counts = [f"{row['ids']}", f"{row['frag']}"]
        rest = [f"{f1:.4f}", f"{row['precision']:.4f}", f"{row['recall']:.4f}"]
        boxes = [f"{row[name]}" for name in ("tp", "fp", "fn")]
        name = f"{level.threshold:.6f} {level.recall_level:.6f}"
        lines.append((name, [f"{share:.4f}" for share in shares] + counts + rest + boxes))
    return lines


@pytest.mark.parametrize("kind", PUBLISHED)
def test_published_table_and_every_level_of_the_log(shared_data: Path, kind: str) -> None:
    reference = shared_data / "kitti_ab3dmot_reference"
    folders = files.Folders(
        shared_data / "kitti_tracking/training/label_02",
        reference / f"pointrcnn_{kind}_val",
        SPLITS["val"],
    )
    found = files.evaluate_folders(folders, KittiRules(kind=kind.lower()))
    metrics = found.metrics
    assert not found.concerns
    cells = files.format_table(found).splitlines()[1].split()
    assert " ".join(cells[1:10]) == PUBLISHED[kind]
    official = published_levels(reference / f"official_eval_3D_iou025_{kind}.log")
    official = [(name, row[:10] + row[11:]) for name, row in official]
    assert printed(metrics) == official


def line(frame: int, track: int, x: float, *, kind: str = "Car", **changes: Any) -> str:
    given = {"truncation": 0, "occlusion": 0, "top": 100, "bottom": 200, "score": 5.0} | changes
    box = f"100 {given['top']} 200 {given['bottom']} 1.5 1.6 4.0 {x} 1.7 20 0"
    text = f"{frame} {track} {kind} {given['truncation']} {given['occlusion']} 0 {box}"
    return text + f" {given['score']}\n"


def write(path: Path, *lines: str) -> Path:
    path.write_text("".join(lines))
    return path


def test_switches_fragments_and_what_does_not_count(tmp_path: Path) -> None:
    truth = [line(f, 0, 0.0, occlusion=3 if f == 9 else 0) for f in range(10)]
    truth += [line(f, 1, 30.0, kind="Van") for f in range(3)]
    regions = [line(f, -1, 0.0, kind="DontCare", top=500, bottom=600) for f in range(3)]
    # the car: missed in 2, found again in 3, another identity in 5
    tracks = [line(f, 7 if f < 5 else 8, 0.1) for f in range(10) if f != 2]
    # a small box, one on a van, one in a region, and two that are wrong
    tracks += [
        line(0, 20, -40.0, bottom=120),
        line(0, 21, 30.0),
        line(0, 22, -20.0, top=510, bottom=600),
    ]
    tracks += [line(1, 23, -20.0), line(2, 23, -20.0)]
    rules = KittiRules()
    sequence = prepare(
        read_boxes(write(tmp_path / "truth.txt", *truth, *regions)),
        read_boxes(write(tmp_path / "tracks.txt", *tracks)),
        rules,
    )
    counts = count(sequence, match(sequence, np.ones(len(tracks), np.bool_), rules.min_iou))
    assert (counts.truth, counts.trajectories) == (9, 1)
    assert (counts.tp, counts.fn, counts.fp) == (10, 1, 2)
    assert (counts.ids, counts.frag) == (1, 2)
    metrics = evaluate([sequence], rules)
    assert metrics.best.counts.fp == 2
    assert 0 < metrics.amota < metrics.samota <= 1


def test_thresholds_take_the_score_nearest_to_each_level() -> None:
    scores = np.linspace(1.0, 0.01, 100)
    points = thresholds(scores, 200, 10)
    assert [round(recall, 6) for _, recall in points] == [0.1, 0.2, 0.3, 0.4, 0.5]
    assert points[0][0] == pytest.approx(0.81)
    assert thresholds(np.zeros(0), 5, 40) == []


def test_image_overlap_and_malformed_input(tmp_path: Path) -> None:
    (tmp_path / "l").mkdir()
    write(tmp_path / "l/0001.txt", line(0, 0, 0.0))
    folders = files.Folders(tmp_path / "l", tmp_path / "l", ("0001",))
    rules = KittiRules(measure="2d", min_iou=0.5)
    assert files.evaluate_folders(folders, rules).metrics.best.mota == 1.0
    with pytest.raises(ConfigError, match="did you mean 'cyclist'"):
        files.evaluate_folders(folders, KittiRules(kind="cyclists"))
    with pytest.raises(ConfigError, match="unknown split"):
        files.sequences_of("vall")
    assert files.sequences_of("0001, 2") == ("0001", "0002")
    bad = line(0, 0, 0.0).replace("1.5 1.6 4.0", "1.5 -1 4.0")
    write(tmp_path / "l/0001.txt", bad)
    assert files.evaluate_folders(folders, rules).metrics.best.mota == 1.0
    with pytest.raises(DataError, match=r"0001\.txt: length, width, height of id 0 in frame 0"):
        files.evaluate_folders(folders, KittiRules())
    write(tmp_path / "l/0001.txt", "0 1 Car 0 0\n")
    with pytest.raises(DataError, match="line 1 is 5 values"):
        files.evaluate_folders(folders, rules)
    write(tmp_path / "l/0001.txt", line(0, 0, float("nan")))
    with pytest.raises(DataError, match="NaN"):
        files.evaluate_folders(folders, rules)


def test_command_writes_table_and_files(shared_data: Path, tmp_path: Path) -> None:
    arguments = ["eval", "kitti", "--split", "0012", "--class", "Cyclist", "--out", str(tmp_path)]
    labels = shared_data / "kitti_tracking/training/label_02"
    tracks = shared_data / "kitti_ab3dmot_reference/pointrcnn_Cyclist_val"
    arguments += ["--labels", str(labels), "--tracks", str(tracks)]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert "cyclist" in result.output
    assert (tmp_path / "kitti.csv").read_text().startswith("class,measure")
    assert (tmp_path / "kitti.json").is_file()

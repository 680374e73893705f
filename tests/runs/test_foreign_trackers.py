"""Stored output of real trackers, made runs."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from mottrack.core.arrays import F64
from mottrack.eval.evaluation import score
from mottrack.eval.scores import ScoreConfig
from mottrack.runs.tracks_in import Import, import_tracks
from mottrack.runs.tracks_out import StoredTracks, write_tracks

SEQUENCE = "0012"
"""The shortest of KITTI's validation part: 78 frames."""


def rows_of(path: Path) -> dict[tuple[int, str], list[F64]]:
    """Return by frame and type the values from height to score."""
    found: dict[tuple[int, str], list[F64]] = {}
    for line in path.read_text().splitlines():
        words = line.split()
        found.setdefault((int(words[0]), words[2]), []).append(np.array(words[10:], float))
    return found


def test_ab3dmots_boxes_come_back_as_they_were(shared_data: Path, tmp_path: Path) -> None:
    """Size, place, heading and score of every box, through the world and back to the camera."""
    kitti = shared_data / "kitti_tracking"
    reference = shared_data / "kitti_ab3dmot_reference"
    tracks = tuple(reference / f"pointrcnn_{k}_val" for k in ("Car", "Pedestrian", "Cyclist"))
    dataset = {"kind": "kitti", "root": str(kitti), "scenes": [SEQUENCE]}
    settings = {"snapshots": {"scenes": 0}}
    imported = import_tracks(Import(tracks, "kitti", dataset, settings), tmp_path / "run")
    assert imported.run.scores.classes["car"].amota > 0.5
    write_tracks(StoredTracks.of(tmp_path / "run"), "kitti", tmp_path / "back")
    back = rows_of(tmp_path / f"back/{SEQUENCE}.txt")
    whole = 0
    for folder in tracks:
        for key, values in rows_of(folder / f"{SEQUENCE}.txt").items():
            for value in values:
                apart = [np.abs(other - value)[[0, 1, 2, 3, 4, 5, 7]].max() for other in back[key]]
                turned = back[key][int(np.argmin(apart))][6] - value[6]
                assert min(apart) < 2e-6
                assert np.cos(turned) == pytest.approx(1.0)
                whole += 1
    assert whole == sum(map(len, back.values())) > 0


@pytest.mark.parametrize(
    ("name", "mota", "idf1"),
    [("TUD-Campus", 0.526462, 0.557659), ("TUD-Stadtmitte", 0.564014, 0.644619)],
)
def test_published_figures_of_an_imported_run(
    shared_data: Path, tmp_path: Path, name: str, mota: float, idf1: float
) -> None:
    source = shared_data / "motchallenge_tud" / name
    (tmp_path / "tracks").mkdir()
    shutil.copy(source / "test.txt", tmp_path / f"tracks/{name}.txt")
    dataset = {"kind": "mot", "root": str(source.parent), "scenes": [name]}
    rules = {"match_by": "iou", "match_iou": 0.5}
    request = Import((tmp_path / "tracks",), "mot", dataset, {"scores": rules})
    run = import_tracks(request, tmp_path / "run").run
    scores = score(
        [run.folder.load(s) for s in run.finished], ScoreConfig.model_validate(rules)
    ).overall
    assert scores.clear.mota == pytest.approx(mota, abs=1e-6)
    assert scores.identity.idf1 == pytest.approx(idf1, abs=1e-6)
    assert json.loads(run.folder.identity_file.read_text())["configuration"]

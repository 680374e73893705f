"""HOTA, IDF1 and intervals of KITTI's files."""

from pathlib import Path

import numpy as np
import pytest

from mottrack.eval.kitti.files import ALL_TRACKS, Folders, evaluate_folders, read_folders
from mottrack.eval.kitti.levels import evaluate
from mottrack.eval.kitti.matching import KittiRules, prepare
from mottrack.eval.kitti.resampling import AVERAGES, profile, resampled

LINE = "{frame} {id} {kind} {cut} 0 0 {left} 100 {right} 160 1.5 1.6 4.0 {x} 1.5 20 0 {score}"


def lines(*rows: dict[str, object]) -> str:
    plain = {"cut": 0, "kind": "Car", "score": 0.9}
    return "\n".join(LINE.format(**plain | row) for row in rows) + "\n"


def car(frame: int, identity: int, x: float, **more: object) -> dict[str, object]:
    return {"frame": frame, "id": identity, "x": x, "left": 10 * x, "right": 10 * x + 60, **more}


@pytest.mark.parametrize("measure", ["3d", "2d"])
def test_distractors_and_what_matches_them_do_not_count(tmp_path: Path, measure: str) -> None:
    """A car found with two identities, a van, a car cut off, and a track in a region of no labels.

    HOTA by hand: every match has similarity 1, DetA = 1, AssA = 2 / 4 for each of four matches.
    """
    labels, tracks = tmp_path / "labels", tmp_path / "tracks"
    labels.mkdir(), tracks.mkdir()
    truth, found = [], []
    for frame in range(4):
        truth += [car(frame, 1, 0.0), car(frame, 2, 20.0, kind="Van"), car(frame, 3, 40.0, cut=1)]
        truth.append(car(frame, -1, 60.0, kind="DontCare"))
        found += [car(frame, 7 + frame // 2, 0.0)]
        found += [car(frame, 20 + k, 20.0 * k) for k in (1, 2, 3)]
    (labels / "0000.txt").write_text(lines(*truth))
    (tracks / "0000.txt").write_text(lines(*found))
    rules = KittiRules(measure=measure, min_iou=0.5)  # type: ignore[arg-type]
    evaluated = evaluate_folders(Folders(labels, tracks, ("0000",)), rules, 20)
    figures = evaluated.identity[ALL_TRACKS].as_dict()
    assert figures["det_a"] == 1.0
    assert figures["ass_a"] == 0.5
    assert figures["hota"] == pytest.approx(np.sqrt(0.5))
    assert figures["idf1"] == figures["idr"] == 0.5
    assert all(np.isnan(ends).all() for ends in evaluated.intervals[ALL_TRACKS].values())


def test_a_resample_that_draws_every_sequence_once_is_the_whole(shared_data: Path) -> None:
    folders = Folders(
        shared_data / "kitti_tracking/training/label_02",
        shared_data / "kitti_ab3dmot_reference/pointrcnn_Cyclist_val",
        ("0012", "0013", "0014", "0016"),
    )
    rules = KittiRules(kind="cyclist")
    prepared = [prepare(p.labels, p.results, rules) for p in read_folders(folders, rules)]
    profiles = [profile(sequence, rules) for sequence in prepared]
    weights = np.array([[1, 1, 1, 1], [0, 2, 0, 1]])
    found = resampled(evaluate(prepared, rules), profiles, weights)
    drawn = evaluate([prepared[1], prepared[1], prepared[3]], rules).as_dict()
    for name in AVERAGES:
        assert found[name].draws[0] == pytest.approx(found[name].value, abs=1e-12), name
        assert found[name].draws[1] == pytest.approx(drawn[name], abs=1e-12), name

"""What evaluations used to score in silence: refused, or told with the exit code 3."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from mottrack.cli import app
from mottrack.core.concerns import ConcernError
from mottrack.core.errors import DataError
from mottrack.eval.mot import score_files
from mottrack.eval.mot_boxes import read_boxes
from mottrack.eval.nuscenes.submission import read_submission


def write(path: Path, *lines: str) -> Path:
    path.write_text("".join(f"{line}\n" for line in lines))
    return path


def mot_pair(tmp_path: Path, truth: list[str], tracks: list[str]) -> tuple[Path, Path]:
    return write(tmp_path / "gt.txt", *truth), write(tmp_path / "t.txt", *tracks)


@pytest.mark.parametrize("further", ["", ",0.5", ",0.5,1"])
def test_the_class_is_the_eighth_column_of_mot(further: str, tmp_path: Path) -> None:
    """As TrackEval reads it: of 8, 9 or 10 columns."""
    truth = [f"1,1,0,0,10,20,1,1{further}", f"1,2,50,0,10,20,1,8{further}"]
    pair = mot_pair(tmp_path, truth, ["1,5,0,0,10,20,1", "1,6,51,0,10,20,1"])
    row = score_files(*pair).scores.as_dict()
    assert (row["truth"], row["fp"], row["fn"]) == (1, 0, 0)


def test_a_place_on_the_ground_is_no_class(tmp_path: Path) -> None:
    path = write(tmp_path / "gt.txt", "1,1,0,0,10,20,1,4.5,5.5,0", "1,2,50,0,10,20,1,2,3,0")
    assert read_boxes(path).kind.tolist() == [-1, -1]
    write(path, "1,1,0,0,10,20,1,1,1", "1,2,50,0,10,20,1,-1,1")
    with pytest.raises(DataError, match=r"line 2, class is -1\.0, expected 1 \.\. 13"):
        read_boxes(path)


MOT = {
    "no pedestrian": (["1,1,0,0,9,9,1,2,1"], ["1,1,0,0,9,9"], "nothing to score: 1, .*2: 1"),
    "no track": (["1,1,0,0,9,9"], [], "no track at all"),
    "no area": (["1,1,0,0,9,9"], ["1,1,0,0,0,9"], "boxes without an area: 1"),
    "id -1": (["1,1,0,0,9,9"], ["1,-1,0,0,9,9"], "ids below 0: 1"),
    "frames from 0": (["1,1,0,0,9,9"], ["0,1,0,0,9,9"], "tracks outside the frames"),
}


@pytest.mark.parametrize("fault", MOT)
def test_mot_files_that_are_hardly_meant(fault: str, tmp_path: Path) -> None:
    truth, tracks, message = MOT[fault]
    pair = mot_pair(tmp_path, truth, tracks)
    command = ["eval", "mot", "--truth", str(pair[0]), "--tracks", str(pair[1])]
    command += ["--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 3, result.output
    with pytest.raises(ConcernError, match=message):
        CliRunner().invoke(app, [*command, "--strict"], catch_exceptions=False)


def kitti_line(frame: int, track: int, *, kind: str = "Car", bottom: int = 200) -> str:
    box = f"100 100 200 {bottom} 1.5 1.6 4.0 {10 * track} 1.7 20 0"
    return f"{frame} {track} {kind} 0 0 0 {box} 0.9"


def kitti(tmp_path: Path, labels: list[str], tracks: list[str], *more: str) -> list[str]:
    for name, lines in (("labels", labels), ("tracks", tracks)):
        (tmp_path / name).mkdir()
        write(tmp_path / name / "0001.txt", *lines)
    command = ["eval", "kitti", "--labels", str(tmp_path / "labels")]
    command += ["--tracks", str(tmp_path / "tracks"), "--split", "0001"]
    return [*command, "--out", str(tmp_path / "out"), *more]


@pytest.mark.parametrize("twice", ["labels", "tracks"])
def test_an_identity_twice_in_a_frame_of_kitti(twice: str, tmp_path: Path) -> None:
    """A row twice used to raise AMOTA from 46.9 to 56.1."""
    one, two = [kitti_line(0, 1)], [kitti_line(0, 1), kitti_line(0, 1)]
    command = kitti(tmp_path, two if twice == "labels" else one, two if twice == "tracks" else one)
    with pytest.raises(DataError, match=rf"{twice}/0001\.txt: id 1 is twice in frame 0"):
        CliRunner().invoke(app, command, catch_exceptions=False)


KITTI = {
    "another type": ([kitti_line(0, 1, kind="2")], "rows of no type of KITTI's: 1"),
    "no car": ([kitti_line(0, 1, kind="Van")], "no car .rows by type: van: 1"),
    "id -1": ([kitti_line(0, 1), kitti_line(0, -1)], "boxes without an identity, left out: 1"),
    "no height": ([kitti_line(0, 1, bottom=100)], "without a height in the image.*: 1"),
    "late": ([kitti_line(0, 1), kitti_line(9, 1)], "results after the last label: 1"),
}


@pytest.mark.parametrize("fault", KITTI)
def test_kitti_results_that_are_hardly_meant(fault: str, tmp_path: Path) -> None:
    tracks, message = KITTI[fault]
    command = kitti(tmp_path, [kitti_line(0, 1)], tracks)
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 3, result.output
    with pytest.raises(ConcernError, match=message):
        CliRunner().invoke(app, [*command, "--strict"], catch_exceptions=False)


def test_labels_without_the_class_are_named(tmp_path: Path) -> None:
    command = kitti(tmp_path, [kitti_line(0, 1, kind="Van")], [kitti_line(0, 1)])
    with pytest.raises(DataError, match=r"/labels: labels is without a car that counts"):
        CliRunner().invoke(app, command, catch_exceptions=False)


def test_a_sample_twice_in_a_submission(tmp_path: Path) -> None:
    box = json.dumps({"sample_token": "t", "tracking_id": "1"})
    path = tmp_path / "s.json"
    path.write_text(f'{{"meta": {{}}, "results": {{"t": [{box}], "t": [{box}]}}}}')
    with pytest.raises(DataError, match=r"results\[t\] is there twice"):
        read_submission(path)

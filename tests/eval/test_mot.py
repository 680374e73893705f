"""MOTChallenge text: published metrics, the distractor rule, malformed files."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from mottrack.cli import app
from mottrack.core.errors import DataError, InputError
from mottrack.eval.mot import score_files
from mottrack.eval.mot_boxes import read_boxes

EXACT = {
    "TUD-Campus": (0.526462, 0.277201, 0.557659),
    "TUD-Stadtmitte": (0.564014, 0.345904, 0.644619),
}


@pytest.mark.parametrize("name", EXACT)
def test_published_figures(shared_data: Path, name: str) -> None:
    folder = shared_data / "motchallenge_tud" / name
    row = score_files(folder / "gt.txt", folder / "test.txt").scores.as_dict()
    assert tuple(round(row[key], 6) for key in ("mota", "motp", "idf1")) == EXACT[name]
    assert 0.3 < row["hota"] < 0.5


def test_command_adds_sequences_up(shared_data: Path, tmp_path: Path) -> None:
    arguments = ["eval", "mot", "--out", str(tmp_path)]
    for name in EXACT:
        folder = shared_data / "motchallenge_tud" / name
        arguments += ["--truth", str(folder / "gt.txt"), "--tracks", str(folder / "test.txt")]
    output = CliRunner().invoke(app, arguments, catch_exceptions=False).output
    assert output.splitlines()[-1].split()[0] == "all"
    content = json.loads((tmp_path / "mot.json").read_text())
    assert content["all"]["truth"] == 359 + 1156
    assert len(content["all"]["alphas"]["hota"]) == 19
    output = CliRunner().invoke(app, [*arguments, "--bootstrap", "50"]).output
    ends = json.loads((tmp_path / "mot.json").read_text())["all"]["intervals"]
    assert ends["hota"][0] < content["all"]["hota"] < ends["hota"][1]
    assert "95 % interval over sequences" in output
    with pytest.raises(InputError, match="--tracks"):
        CliRunner().invoke(app, [*arguments, "--truth", "x"], catch_exceptions=False)


def test_boxes_on_distractors_and_rows_of_confidence_zero_do_not_count(tmp_path: Path) -> None:
    truth, tracks = tmp_path / "gt.txt", tmp_path / "t.txt"
    truth.write_text("1,1,0,0,10,20,1,1,1\n1,2,50,0,10,20,1,8,1\n1,3,90,0,10,20,0,1,1\n")
    tracks.write_text("1,5,0,0,10,20,1,-1,-1,-1\n1,6,51,0,10,20,1,-1,-1,-1\n")
    row = score_files(truth, tracks).scores.as_dict()
    assert (row["truth"], row["fp"], row["fn"], row["hota"]) == (1, 0, 0, pytest.approx(1.0))


def test_errors_name_the_line(tmp_path: Path) -> None:
    path = tmp_path / "x.txt"
    for text, complaint in (
        ("1,1,0,0,5\n", "line 1 is 5 values"),
        ("1,1,0,0,5,5\n1,x,0,0,5,5\n", "line 2"),
        ("1,1,0,0,5,nan\n", "NaN"),
        ("1.5,1,0,0,5,5\n", r"line 1, frame is 1\.5, expected a whole number"),
        ("1,1e30,0,0,5,5\n", "line 1, id is"),
        ("1,1,0,0,5,5\n1,1,9,0,5,5\n", "line 2, id is 1.0, expected each id once a frame"),
    ):
        path.write_text(text)
        with pytest.raises(DataError, match=complaint):
            read_boxes(path)
    path.write_bytes(b"1,1,\xff\n")
    with pytest.raises(DataError, match="line 1 is 0xff at byte 4, expected UTF-8 text"):
        read_boxes(path)
    path.write_text("")
    assert len(read_boxes(path)) == 0


def test_stamps_in_place_of_frame_numbers_take_no_memory(tmp_path: Path) -> None:
    path = tmp_path / "x.txt"
    path.write_text("".join(f"{10**12 + k},1,0,0,5,5\n" for k in (0, 1, 5)))
    assert score_files(path, path).scores.as_dict()["mota"] == 1.0


def test_commas_and_white_space_are_read_alike(tmp_path: Path) -> None:
    lines = ["1,1,10,20,5,5,1,1,0.5", "2,1,11.25,20,5,5,0,7,1", "", "1,3,1e1,2,5,5,1,2,1"]
    comma, spaced, blank = (tmp_path / f"{name}.txt" for name in ("comma", "spaced", "blank"))
    comma.write_text("\n".join(lines))
    spaced.write_text("\n".join(lines).replace(",", ", "))
    blank.write_text("\n".join(lines).replace(",", " "))
    expected = read_boxes(comma)
    assert expected.frame.tolist() == [1, 1, 2]
    assert expected.kind.tolist() == [1, 2, 7]
    for path in (spaced, blank):
        read = read_boxes(path)
        for name in read.__dataclass_fields__:
            np.testing.assert_array_equal(getattr(read, name), getattr(expected, name))
    for fault in ("1,1.5,1,1,5,5", "1,1,nan,1,5,5", "1,1,1,1,5", "9007199254740993,1,1,1,5,5"):
        comma.write_text(fault)
        with pytest.raises(DataError, match="line 1"):
            read_boxes(comma)

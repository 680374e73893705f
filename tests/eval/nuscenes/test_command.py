"""`mottrack eval nuscenes`: its files, its tables, its warnings."""

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from mottrack.cli import app
from mottrack.eval.nuscenes.submission_checks import SubmissionError


def run(case: Any, out: Path, *more: str, code: int = 0) -> str:
    arguments = ["eval", "nuscenes", "--dataroot", str(case.data), "--split", str(case.scenes)]
    arguments += ["--submission", str(case.data / "submission.json"), "--out", str(out), *more]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result.output


def test_all_options_write_their_files_and_tables(golden: dict[str, Any], tmp_path: Path) -> None:
    case = golden["base_s11_n3"]
    other = ["--compare", str(case.data / "submission.json")]
    output = run(case, tmp_path, "--hota", "--error-classes", "--bootstrap", "5", *other)
    assert "0.595" in output.splitlines()[10]
    for text in ("interpolation of gaps: official", "re-identification", "idf1", "95% intervals"):
        assert text in output
    names = {path.name for path in tmp_path.iterdir()}
    files = "metrics_summary.json metrics_details.json metrics.csv recall_curves.png hota.json "
    files += "error_classes.json bootstrap.json comparison.json velocity_error.json"
    assert set(files.split()) <= names
    same = json.loads((tmp_path / "comparison.json").read_text())["differences"]["all"]["amota"]
    assert (same["low"], same["high"], same["significant"], same["scenes"]) == (0, 0, False, 3)
    for name in names:
        if name.endswith(".json") and name not in ("metrics_summary.json", "metrics_details.json"):
            json.loads((tmp_path / name).read_text(), parse_constant=pytest.fail)
    assert (
        (tmp_path / "metrics.csv").read_text().splitlines()[-1].startswith("all,official,0.59488")
    )


def test_warnings_go_to_a_file_and_strict_stops_at_them(
    golden: dict[str, Any], tmp_path: Path
) -> None:
    case = golden["edge_s14_n3"]
    output = run(case, tmp_path, "--no-picture", code=3)
    assert "more of num_pts (problems.json)" in output
    assert len(json.loads((tmp_path / "problems.json").read_text())) > 100
    with pytest.raises(SubmissionError):
        run(case, tmp_path, "--strict", "--no-picture")


def test_the_velocity_error_may_be_left_out(golden: dict[str, Any], tmp_path: Path) -> None:
    output = run(golden["base_s11_n3"], tmp_path, "--no-picture", "--no-velocity-error")
    assert "velocity" not in output
    assert not (tmp_path / "velocity_error.json").exists()


def test_a_second_submission_is_checked_like_the_first(
    golden: dict[str, Any], tmp_path: Path
) -> None:
    case = golden["base_s11_n3"]
    content = json.loads((case.data / "submission.json").read_text())
    for boxes in content["results"].values():
        for box in boxes:
            box["velocity"] = [0.0, 0.0]
    standing, other_split = tmp_path / "standing.json", tmp_path / "other_split.json"
    standing.write_text(json.dumps(content))
    output = run(case, tmp_path / "out", "--no-picture", "--compare", str(standing))
    assert "standing.json: the velocity of every box is 0" in output
    next(boxes for boxes in content["results"].values() if boxes)[0]["velocity"] = [300.0, 0.0]
    standing.write_text(json.dumps(content))
    output = run(case, tmp_path / "out", "--no-picture", "--compare", str(standing), code=3)
    assert "velocity: [300.0, 0.0] is not within 100 m/s" in output
    results = {f"x{token}": [] for token in content["results"]}
    other_split.write_text(json.dumps(content | {"results": results}))
    with pytest.raises(SubmissionError, match="not in split"):
        run(case, tmp_path / "none", "--no-picture", "--compare", str(other_split))
    assert not (tmp_path / "none").exists()

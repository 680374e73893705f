"""Problems of a submission: all are reported at once, each with its place."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mottrack.core.errors import DataError
from mottrack.eval.nuscenes import command
from mottrack.eval.nuscenes.boxes import Samples
from mottrack.eval.nuscenes.rules import Rules
from mottrack.eval.nuscenes.submission import Submission, read_submission
from mottrack.eval.nuscenes.submission_checks import (
    Problem,
    SubmissionError,
    is_clean,
    raise_all,
    validate,
)


@pytest.fixture
def samples(make_problem: Callable[..., Any]) -> Samples:
    found: Samples = make_problem(0, scenes=1, frames=3)[0].samples
    return found


def box(sample: str, **changes: Any) -> dict[str, Any]:
    good = {
        "sample_token": sample,
        "translation": [1.0, 2.0, 0.5],
        "size": [2.0, 4.0, 1.5],
        "rotation": [1.0, 0.0, 0.0, 0.0],
        "velocity": [0.0, float("nan")],
        "tracking_id": "1",
        "tracking_name": "car",
        "tracking_score": 0.5,
    }
    return {key: value for key, value in (good | changes).items() if value is not None}


def problems(samples: Samples, results: dict[str, Any]) -> list[Problem]:
    return validate(Submission(Path("s.json"), {}, results), samples, Rules())


def test_a_good_submission_has_no_problem(samples: Samples) -> None:
    good = {token: [box(token)] for token in samples.token.tolist()}
    assert is_clean(good, Rules())
    assert problems(samples, good) == []


@pytest.mark.parametrize(
    ("changes", "field", "severity"),
    [
        ({"translation": [1.0, float("nan"), 0.0]}, "translation", "error"),
        ({"translation": [1.0, 2.0]}, "translation", "error"),
        ({"size": [float("inf"), 1.0, 1.0]}, "size", "error"),
        ({"size": [0.0, 1.0, 1.0]}, "size", "warning"),
        ({"rotation": [0.0, 0.0, 0.0, 0.0]}, "rotation", "warning"),
        ({"rotation": [1.0, 0.5, 0.0, 0.0]}, "rotation", "warning"),
        ({"velocity": [0.0, float("inf")]}, "velocity", "error"),
        ({"tracking_name": "tank"}, "tracking_name", "error"),
        ({"tracking_score": None}, "tracking_score", "warning"),
        ({"tracking_score": float("nan")}, "tracking_score", "error"),
        ({"tracking_score": 1.5}, "tracking_score", "warning"),
        ({"tracking_id": 1.5}, "tracking_id", "error"),
        ({"num_pts": "many"}, "num_pts", "error"),
        ({"num_pts": 0}, "num_pts", "warning"),
        ({"sample_token": "other"}, "sample_token", "warning"),
    ],
)
def test_each_problem_of_a_box_is_reported_with_its_place(
    samples: Samples, changes: dict[str, Any], field: str, severity: str
) -> None:
    results = {token: [box(token)] for token in samples.token.tolist()}
    results["t1"].append(box("t1", tracking_id="2") | changes)
    results["t1"][1] = {k: v for k, v in results["t1"][1].items() if v is not None}
    assert not is_clean(results, Rules())
    (found,) = problems(samples, results)
    assert (found.severity, found.sample, found.box, found.field) == (severity, "t1", 1, field)
    assert str(found).startswith(f"{severity}: s.json: sample t1, box 1: {field}: ")


def test_problems_of_samples_and_tracks_are_reported_together(samples: Samples) -> None:
    results = {
        "t0": [box("t0"), box("t0")],
        "t1": [box("t1", tracking_name="truck")]
        + [box("t1", tracking_id=str(k)) for k in range(2, 503)],
        "elsewhere": [],
    }
    found = [(p.severity, p.field, p.message) for p in problems(samples, results)]
    assert ("error", "results", "sample of scene-0000 is missing") in found
    assert ("error", "results", "sample is not in the split") in found
    assert ("error", "results", "502 boxes, at most 500 are allowed") in found
    assert ("warning", "tracking_id", "'1' is twice in the sample") in found
    assert ("warning", "tracking_name", "track '1' changes from 'car' to 'truck'") in found
    assert [severity for severity, *_ in found] == sorted(s for s, *_ in found)


def test_boxes_in_the_frame_of_the_vehicle_are_recognised(samples: Samples) -> None:
    samples.ego_xy_m[:] = [1500.0, 800.0]
    results = {token: [box(token)] for token in samples.token.tolist()}
    (found,) = problems(samples, results)
    assert "ego instead of global" in found.message


def test_an_error_comes_with_every_warning() -> None:
    raise_all([])
    many = [Problem("error", Path("s.json"), "t", k, "size", "m") for k in range(29)]
    many.append(Problem("warning", Path("s.json"), "t", 0, "rotation", "m"))
    with pytest.raises(SubmissionError, match="and 10 more problems; all by field: size 29, rot"):
        raise_all(many)
    with pytest.raises(SubmissionError, match=r"error: s\.json(.|\n)*warning: s\.json"):
        raise_all(many[-2:])


def test_files_that_are_no_submission(tmp_path: Path) -> None:
    path = tmp_path / "s.json"
    with pytest.raises(DataError, match="No such file"):
        read_submission(path)
    path.write_text('{"meta": {}')
    with pytest.raises(DataError, match="JSON"):
        read_submission(path)
    path.write_text("[1, 2]")
    with pytest.raises(DataError, match="meta is NoneType"):
        read_submission(path)
    path.write_text('{"meta": {}, "results": {"t": [{"velocity": [NaN, Infinity]}]}}')
    assert read_submission(path).results["t"][0]["velocity"][1] == float("inf")


def test_extra_samples_are_traced_to_their_split(golden: dict[str, Any], tmp_path: Path) -> None:
    case = golden["base_s11_n3"]
    scenes = case.scenes.read_text().split()
    (tmp_path / "two.txt").write_text("# two of three\n" + "\n".join(scenes[:2]))
    request = command.Request(
        case.data, "v1.0-trainval", str(tmp_path / "two.txt"), case.data / "submission.json"
    )
    with pytest.raises(SubmissionError, match=r"40 samples are not in split .*: 40 belong to val"):
        command.run(request)


def test_cache_is_used_until_a_table_changes(golden: dict[str, Any], private_cache: Path) -> None:
    case = golden["perfect_s16_n2"]
    request = command.Request(
        case.data, "v1.0-trainval", str(case.scenes), case.data / "submission.json"
    )
    first = command.ground_truth(request)
    (file,) = private_cache.iterdir()
    made = file.stat().st_mtime_ns
    again = command.ground_truth(request)
    assert file.stat().st_mtime_ns == made
    assert (again.boxes.centre_m == first.boxes.centre_m).all()
    table = case.data / "v1.0-trainval/sample_annotation.json"
    rows = json.loads(table.read_text())
    table.write_text(json.dumps(rows[:200]))
    try:
        with pytest.raises(DataError, match="number of records is 200"):
            command.ground_truth(request)
    finally:
        table.write_text(json.dumps(rows))
    file.write_bytes(b"damaged")
    assert len(command.ground_truth(request).boxes) == len(first.boxes)

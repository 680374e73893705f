"""Waymo's MOTA: cases worked out by hand, its files, the command."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from mottrack.cli import app
from mottrack.core.errors import DataError
from mottrack.eval.waymo import files
from mottrack.eval.waymo.boxes import PARTS, Segment, SegmentBoxes, WaymoRules
from mottrack.eval.waymo.metrics import WaymoCounts, count, evaluate, part_sequence

pytest.importorskip("google.protobuf")
CAR = 1


def boxes(*rows: tuple[int, int, float], level: int = 0) -> SegmentBoxes:
    """Cars of frame, identity and place along x, 4 m long: 0.4 m apart they overlap by 0.82."""
    frame, identity, x = (np.array(c) for c in zip(*sorted(rows), strict=True))
    n = len(rows)
    box = np.tile([0.0, 5.0, 0.0, 4.0, 2.0, 1.5, 0.0], (n, 1))
    box[:, 0] = x
    kind, ignored = np.full(n, CAR), np.zeros(n, np.bool_)
    return SegmentBoxes(frame, identity, kind, box, np.full(n, 0.5), np.full(n, level), ignored)


def counts(truth: SegmentBoxes, tracks: SegmentBoxes, level: int = 2) -> WaymoCounts:
    segment = Segment("s", int(truth.frame.max()) + 1, truth, tracks)
    return count(part_sequence(segment, PARTS[0], WaymoRules()), 0.0)[level]


def test_an_object_that_loses_its_identity_to_another_is_a_mismatch_where_it_is_gone() -> None:
    truth = boxes((0, 1, 0.0), (0, 2, 20.0), (1, 1, 0.0))
    taken = boxes((0, 7, 0.0), (0, 8, 20.0), (1, 8, 0.0))
    # object 1 changes to 8, and object 2, which is not in the frame, loses it
    assert counts(truth, taken).mismatches == 2
    # where object 2 is there, to be missed counts alone
    there = counts(boxes((0, 1, 0.0), (0, 2, 20.0), (1, 1, 0.0), (1, 2, 20.0)), taken)
    assert (there.mismatches, there.misses) == (1, 1)


def test_a_kept_match_comes_before_a_better_one_and_a_gap_does_not_end_it() -> None:
    truth = boxes(*((k, 1, 0.0) for k in range(4)))
    tracks = boxes((0, 7, 0.4), (3, 7, 0.4), (3, 8, 0.0))
    found = counts(truth, tracks)
    assert (found.matches, found.misses, found.mismatches, found.false_positives) == (2, 2, 0, 1)
    assert found.cost == pytest.approx(2 * (1 - 3.6 / 4.4))


def test_a_hard_object_that_is_not_found_is_no_miss_at_the_easy_level() -> None:
    truth, tracks = boxes((0, 1, 0.0), (0, 2, 20.0), level=2), boxes((0, 7, 0.0))
    easy, hard = (counts(truth, tracks, level) for level in (1, 2))
    assert (easy.truth, easy.misses) == (1, 0)
    assert (hard.truth, hard.misses) == (2, 1)


def test_nothing_above_zero_is_reported_as_zero() -> None:
    segment = Segment("s", 1, boxes((0, 1, 0.0)), boxes((0, 7, 10.0), (0, 8, 20.0)))
    found = evaluate([segment])["VEHICLE", 2]
    assert (found.mota, found.miss, found.truth) == (0.0, 0.0, 1)


def content(rows: list[dict[str, Any]]) -> bytes:
    made = files._messages()()
    for row in rows:
        plain = {"context_name": "s", "frame_timestamp_micros": 1, "score": 0.5} | row
        made_object = made.objects.add()
        label = {"type": CAR, "id": "a"} | plain.pop("label", {})
        size = {"length": 4.0, "width": 2.0, "height": 1.5} | plain.pop("box", {})
        for name, value in plain.items():
            setattr(made_object, name, value)
        for name, value in label.items():
            setattr(made_object.object, name, value)
        for name, value in size.items():
            setattr(made_object.object.box, name, value)
    return bytes(made.SerializeToString())


def test_command_reads_official_files(tmp_path: Path) -> None:
    truth, tracks = tmp_path / "gt.bin", tmp_path / "tracks.bin"
    truth.write_bytes(content([{"frame_timestamp_micros": k} for k in range(4)]))
    said = [{"frame_timestamp_micros": k, "label": {"id": f"{k // 2}"}} for k in range(4)]
    said += [{"frame_timestamp_micros": 2, "box": {"center_x": 40.0}, "label": {"id": "9"}}]
    said[-1]["overlap_with_nlz"] = True
    tracks.write_bytes(content(said))
    arguments = ["eval", "waymo", "--truth", str(truth), "--tracks", str(tracks), "--out"]
    shown = CliRunner().invoke(app, [*arguments, str(tmp_path / "o")], catch_exceptions=False)
    found = json.loads((tmp_path / "o/waymo.json").read_text())["VEHICLE LEVEL_2"]
    assert (found["mota"], found["mismatch"], found["false_positive"]) == (0.75, 0.25, 0.0)
    assert "VEHICLE [0, 30)" in shown.output


@pytest.mark.parametrize(
    ("row", "complaint"),
    [
        ({"box": {"center_x": float("nan")}}, "box of object 1"),
        ({"box": {"width": -1.0}}, "box of object 1"),
        ({"score": 2.0}, r"score of object 1 is 2\.0"),
        ({"label": {"type": 9}}, "type of object 1 is 9"),
        ({"context_name": "other"}, "context_name of object 1 is other"),
        ({"frame_timestamp_micros": 1}, "id of object 1 is a, expected each identity once"),
        ({"label": {"id": ""}}, "id of object 1"),
    ],
)
def test_faults_name_the_object(tmp_path: Path, row: dict[str, Any], complaint: str) -> None:
    truth, tracks = tmp_path / "gt.bin", tmp_path / "tracks.bin"
    truth.write_bytes(content([{}]))
    tracks.write_bytes(content([{}, {"frame_timestamp_micros": 2} | row]))
    with pytest.raises(DataError, match=complaint):
        list(files.read_segments(truth, tracks))
    for damaged in (b"", b"not a message", content([{}])[:-5]):
        tracks.write_bytes(damaged)
        with pytest.raises(DataError, match=r"tracks\.bin"):
            list(files.read_segments(truth, tracks))

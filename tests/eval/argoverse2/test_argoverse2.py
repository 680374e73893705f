"""Argoverse 2's tracking metrics: figures worked out by hand, files, the command."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.feather
import pytest
from typer.testing import CliRunner

from mottrack.cli import app
from mottrack.core.errors import DataError
from mottrack.eval.argoverse2.files import read_logs
from mottrack.eval.argoverse2.metrics import evaluate

FRAMES = 4
CAR = "REGULAR_VEHICLE"
Rows = list[dict[str, Any]]


def box(frame: int, track: str, x: float, **more: Any) -> dict[str, Any]:
    place = {"tx_m": x, "ty_m": 0.0, "tz_m": 0.0}
    return {"timestamp_ns": frame, "track_uuid": track, "category": CAR, **place, **more}


def tracked(frame: int, track: str, x: float, **more: Any) -> dict[str, Any]:
    return {"log_id": "log", "score": 0.5, **box(frame, track, x), **more}


def write(root: Path, truth: Rows, tracks: Rows) -> tuple[Path, Path]:
    """A log whose vehicle drives along x at 10 m a frame, looking along y."""
    log = root / "val/log"
    log.mkdir(parents=True, exist_ok=True)
    half = np.sqrt(0.5)
    poses = [
        {"timestamp_ns": k, "qw": half, "qx": 0.0, "qy": 0.0, "qz": half, "tx_m": 10.0 * k}
        | {"ty_m": 5.0, "tz_m": 0.0}
        for k in range(FRAMES)
    ]
    for path, rows in (
        (log / "annotations.feather", truth),
        (log / "city_SE3_egovehicle.feather", poses),
        (root / "tracks.feather", tracks),
    ):
        pyarrow.feather.write_feather(pa.Table.from_pylist(rows), path)
    return root / "val", root / "tracks.feather"


def test_figures_worked_out_by_hand(tmp_path: Path) -> None:
    """Two cars, four frames; one is never found, the other's track is 0.5 m off and changes once.

    Of alpha = 0.05 .. 0.95 those up to the similarity 0.75 count: 15 of 19. There TP = 4, FN = 4,
    FP = 0; each of two identities covers 2 of the object's 4 frames.
    """
    truth = [box(k, t, x) for k in range(FRAMES) for t, x in (("a", 8.0), ("b", 20.0))]
    truth += [box(k, "far", 60.0) for k in range(FRAMES)]
    tracks = [tracked(k, "1" if k < 2 else "2", 8.5) for k in range(FRAMES)]
    tracks += [tracked(k, "3", 60.0, score=0.9) for k in range(FRAMES)]
    (log,) = read_logs(*write(tmp_path, truth, tracks))
    np.testing.assert_allclose(log.truth.xy_m[0], [0.0, 13.0], atol=1e-12)
    metrics = evaluate([log])
    found = metrics[CAR].at(metrics[CAR].best("hota"))
    det_a, ass_a = 4 / 8, 2 / 4
    assert found["hota"] == pytest.approx(15 / 19 * np.sqrt(det_a * ass_a))
    assert (found["tp"], found["fn"], found["fp"], found["ids"]) == (4, 4, 0, 1)
    assert found["mota"] == pytest.approx((4 - 1) / 8)
    assert found["motp"] == pytest.approx(0.75)
    assert (found["mt"], found["ml"], found["truth_tracks"]) == (1, 1, 2)
    # every threshold keeps the tracks: all have one score
    assert metrics[CAR].figures()["amota"] == pytest.approx(3 / 8)
    assert metrics["BUS"].figures() == dict.fromkeys(("hota", "mota", "amota", "ahota"), 0.0)


def test_recorded_log_against_itself(shared_data: Path, tmp_path: Path) -> None:
    split = tmp_path / "val"
    split.mkdir()
    source = next((shared_data / "argoverse2/val").glob("adcf7d18-*"))
    (split / "log").symlink_to(source)
    table = pyarrow.feather.read_table(source / "annotations.feather")
    rows = table.num_rows
    table = table.append_column("log_id", pa.array(["log"] * rows))
    table = table.append_column("score", pa.array(np.linspace(0.1, 1.0, rows)))
    pyarrow.feather.write_feather(table, tmp_path / "tracks.feather")
    arguments = ["eval", "argoverse2", "--dataroot", str(split), "--bootstrap", "20"]
    arguments += ["--tracks", str(tmp_path / "tracks.feather"), "--out", str(tmp_path / "out")]
    shown = CliRunner().invoke(app, arguments, catch_exceptions=False).output
    content = json.loads((tmp_path / "out/argoverse2.json").read_text())
    scored = {n: m for n, m in content["categories"].items() if m["at_best_hota"]["truth"]}
    assert scored
    assert all(m["hota"] == m["mota"] == pytest.approx(1.0) for m in scored.values())
    assert content["mean"]["amota"] < 1.0  # lower recall levels leave boxes out
    assert content["intervals"]["mean"]["hota"] == [None, None]  # of one log
    assert [line.split()[0] for line in shown.splitlines() if line.startswith(CAR)] == [CAR]


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"log_id": "other"}, "log_id of row 1 is other, expected a log of val"),
        ({"timestamp_ns": 9}, "timestamp_ns of row 1 is 9, expected an annotated time"),
        ({"timestamp_ns": 0}, "track_uuid of row 1 is 1, expected each track once a time"),
        ({"tx_m": 1e5}, "translation of row 1"),
        ({"score": float("nan")}, "score of row 1 is nan"),
        ({"track_uuid": ""}, "track_uuid of row 1"),
    ],
)
def test_faults_name_the_row(tmp_path: Path, change: dict[str, Any], complaint: str) -> None:
    truth = [box(k, "a", 8.0) for k in range(FRAMES)]
    tracks = [tracked(k, "1", 8.0) for k in range(FRAMES)]
    tracks[1] |= change
    with pytest.raises(DataError, match=complaint):
        list(read_logs(*write(tmp_path, truth, tracks)))
    write(tmp_path, [box(k, "a", 8.0) for k in range(FRAMES + 1)], tracks[:1])
    with pytest.raises(DataError, match=r"without \[4\]"):
        list(read_logs(tmp_path / "val", tmp_path / "tracks.feather"))

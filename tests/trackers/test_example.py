"""The example that users copy from."""

import json
import subprocess
import sys
from pathlib import Path

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "track_own_detections.py"


def test_tracks_plain_arrays_into_a_submission(tmp_path: Path) -> None:
    out = tmp_path / "submission.json"
    subprocess.run([sys.executable, str(EXAMPLE), str(out)], check=True)
    submission = json.loads(out.read_text())
    boxes = [box for sample in submission["results"].values() for box in sample]
    assert len(submission["results"]) == 20
    assert {box["tracking_id"] for box in boxes} == {"1", "2", "3"}
    moving = [b for b in boxes if b["tracking_name"] == "car" and b["velocity"][0] > 7]
    assert len(moving) > 10

"""MOTA of the Waymo Open Dataset beside its official operation, in an environment of its own.

The operation takes a box's difficulty for that of detection, and tracking's as unknown, so both of
its levels are LEVEL_2; LEVEL_1 is worked out by hand in tests/eval/waymo.
"""

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mottrack.eval.waymo.boxes import Segment, SegmentBoxes, WaymoRules
from mottrack.eval.waymo.metrics import evaluate

HERE = Path(__file__).resolve().parent
PYTHON = Path(os.environ.get("MOTTRACK_WAYMO_PYTHON", HERE.parents[1] / ".venv-waymo/bin/python"))
TYPES = ("VEHICLE", "PEDESTRIAN", "SIGN", "CYCLIST")
FIGURES = ("mota", "motp", "miss", "mismatch", "false_positive", "cutoff")


def made_segment(name: int, rng: np.random.Generator) -> Segment:
    """Boxes that walk, meet, are lost, change identity and range, and zones without labels."""
    frames = int(rng.integers(3, 20))
    rows: dict[str, list[tuple[float, ...]]] = {"truth": [], "tracks": []}
    for number in range(int(rng.integers(2, 14))):
        kind = int(rng.integers(1, 5))
        centre = rng.uniform(-1, 1, 2) * rng.choice([4.0, 30.0, 60.0])
        step, heading = rng.normal(0, 0.6, 2), float(rng.uniform(-3, 3))
        identity, score = number, float(rng.random())
        for frame in range(frames):
            centre = centre + step
            identity += 100 * int(rng.random() < 0.07)
            box = (*centre, 1.0, 4.5, 2.0, 1.6, heading)
            if rng.random() < 0.85:
                rows["truth"].append((frame, number, kind, *box, 0, rng.integers(0, 3), 0))
            if rng.random() < 0.85:
                noise = rng.normal(0, rng.choice([0.02, 0.15, 0.5]), 2)
                near = (*(centre + noise), 1.05, 4.4, 2.1, 1.5, heading + rng.normal(0, 0.05))
                mark = float(np.clip(score + rng.normal(0, 0.1), 0, 1))
                rows["tracks"].append((frame, identity, kind, *near, mark, 0, rng.random() < 0.1))
    return Segment(str(name), frames, *(boxes(rows[side]) for side in ("truth", "tracks")))


def boxes(rows: list[tuple[float, ...]]) -> SegmentBoxes:
    table = np.array(sorted(rows, key=lambda row: row[0]), np.float64).reshape(-1, 13)
    frame, identity, kind = (table[:, k].astype(np.int64) for k in range(3))
    # the operation takes single precision
    box, score = (table[:, s].astype(np.float32).astype(np.float64) for s in (slice(3, 10), 10))
    level, ignored = table[:, 11].astype(np.int64), table[:, 12] > 0
    return SegmentBoxes(frame, identity, kind, box, score, level, ignored)


def official(segments: list[Segment], rules: WaymoRules, scratch: Path) -> dict[str, list[float]]:
    content: dict[str, Any] = {"cutoffs": np.array(rules.cutoffs)}
    for side in ("truth", "tracks"):
        parts = [getattr(s, side) for s in segments]
        names = {"box": "box", "type": "kind", "frame": "frame", "id": "id", "level": "level"}
        names |= {"score": "score", "ignored": "ignored"}
        for key, name in names.items():
            content[f"{side}_{key}"] = np.concatenate([getattr(p, name) for p in parts])
        numbers = np.repeat(np.arange(len(segments)), [len(p) for p in parts])
        content[f"{side}_sequence"] = numbers
    np.savez(scratch / "in.npz", **content)
    command = [str(PYTHON), str(HERE / "waymo_evaluation.py"), str(scratch / "in.npz")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    found: dict[str, list[float]] = json.loads(done.stdout.splitlines()[-1])
    return found


@pytest.mark.parametrize("seed", range(4))
def test_made_segments_equal_the_official_operation(seed: int, tmp_path: Path) -> None:
    if not PYTHON.is_file():
        pytest.skip("no .venv-waymo here: `make oracle` makes it on x86-64")
    rng = np.random.default_rng(seed)
    segments = [made_segment(k, rng) for k in range(6)]
    rules = WaymoRules()
    theirs, ours = official(segments, rules, tmp_path), evaluate(segments, rules)
    assert len(theirs) == len(ours) == 32
    for part, level in ours:
        metrics = ours[part, 2]
        kind, _, ring = part.partition(" ")
        group = f"RANGE_TYPE_{kind}_{ring}" if ring else f"OBJECT_TYPE_TYPE_{kind}"
        found = theirs[f"{group}_LEVEL_{level}"]
        for name, value in zip(FIGURES, found, strict=True):
            assert getattr(metrics, name) == pytest.approx(value, abs=2e-6), (part, level, name)

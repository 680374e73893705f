"""HOTA and IDF1 of KITTI's files beside TrackEval's own reader of them."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from trackeval.datasets import Kitti2DBox
from trackeval.metrics import HOTA, Identity

from mottrack.eval.kitti.files import Folders, read_folders
from mottrack.eval.kitti.identity_scores import identity_sums, total
from mottrack.eval.kitti.matching import SPLITS, KittiRules

DEFAULT = Path(__file__).resolve().parents[3] / "shared/data"
SHARED = Path(os.environ.get("MOTTRACK_SHARED_DATA", DEFAULT))


@pytest.mark.parametrize("kind", ["Car", "Pedestrian"])
def test_real_files_equal_trackeval(kind: str, tmp_path: Path) -> None:
    labels = SHARED / "kitti_tracking/training/label_02"
    tracks = SHARED / f"kitti_ab3dmot_reference/pointrcnn_{kind}_val"
    if not labels.is_dir():
        pytest.skip("no recorded data here")
    sequences = SPLITS["val"][:5]
    official = of_trackeval(kind, labels, tracks, sequences, tmp_path)
    rules = KittiRules(kind=kind.lower(), measure="2d", min_iou=0.5)
    pairs = read_folders(Folders(labels, tracks, sequences), rules)
    found = total([identity_sums(pair, rules) for pair in pairs]).as_dict()
    for name, value in official.items():
        assert found[name] == pytest.approx(value, abs=1e-9), name


def of_trackeval(
    kind: str, labels: Path, tracks: Path, sequences: tuple[str, ...], scratch: Path
) -> dict[str, float]:
    """The figures of TrackEval, its data set pointed at these folders."""
    (scratch / "gt").mkdir()
    (scratch / "gt/label_02").symlink_to(labels)
    (scratch / "tracks/ours").mkdir(parents=True)
    (scratch / "tracks/ours/data").symlink_to(tracks)
    lines = []
    for name in sequences:
        last = [
            p.read_text().splitlines() for p in (labels / f"{name}.txt", tracks / f"{name}.txt")
        ]
        frames = 1 + max(int(line.split()[0]) for side in last for line in side)
        lines.append(f"{name} empty 000000 {frames:06d}")
    (scratch / "gt/evaluate_tracking.seqmap.training").write_text("\n".join(lines) + "\n")
    data: Any = Kitti2DBox(
        {
            "GT_FOLDER": str(scratch / "gt"),
            "TRACKERS_FOLDER": str(scratch / "tracks"),
            "TRACKERS_TO_EVAL": ["ours"],
            "CLASSES_TO_EVAL": [kind.lower()],
            "SPLIT_TO_EVAL": "training",
            "PRINT_CONFIG": False,
        }
    )
    metrics: tuple[Any, Any] = HOTA(), Identity({"THRESHOLD": 0.5, "PRINT_CONFIG": False})
    every: tuple[dict[str, Any], dict[str, Any]] = {}, {}
    for name in sequences:
        content = data.get_preprocessed_seq_data(data.get_raw_seq_data("ours", name), kind.lower())
        for metric, found in zip(metrics, every, strict=True):
            found[name] = metric.eval_sequence(content)
    hota, identity = (m.combine_sequences(e) for m, e in zip(metrics, every, strict=True))
    names = {"hota": "HOTA", "det_a": "DetA", "ass_a": "AssA", "loc_a": "LocA"}
    own = {"idf1": "IDF1", "idp": "IDP", "idr": "IDR"}
    return {ours: float(np.mean(hota[n])) for ours, n in names.items()} | {
        ours: float(identity[n]) for ours, n in own.items()
    }

"""Our metrics beside those that the peers compute in the same environment."""

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from devkit_evaluation import evaluate_folder
from nuscenes.utils import splits
from scenarios import Scenario
from trackeval.metrics import CLEAR, HOTA, Identity

from mottrack.core.errors import MottrackError
from mottrack.eval import clear, hota, identity
from mottrack.eval.mot import image_pairs, preprocess
from mottrack.eval.mot_boxes import read_boxes
from mottrack.eval.nuscenes import command
from mottrack.eval.nuscenes.outputs import details_json, summary_json
from mottrack.eval.nuscenes.rules import Rules
from mottrack.eval.pairs import BoxStream, Measure, Measured, Pairs, find_pairs, iou_gate
from mottrack.formats.nuscenes_splits import SPLITS, split_scenes

SCENARIOS = int(os.environ.get("MOTTRACK_ORACLE_SCENARIOS", "200"))
SHARED = Path(__file__).resolve().parents[3] / "shared/data"
COUNTS = {"gt", "tp", "fp", "fn", "ids", "frag", "mt", "ml"}


def test_split_names_are_the_official_ones() -> None:
    official = splits.create_splits_scenes()
    assert set(SPLITS) == set(official)
    for name in SPLITS:
        assert list(split_scenes(name)) == sorted(official[name])


def differences(ours: Any, official: Any, where: str = "") -> list[str]:
    """Every place where the values differ: counts at all, floats by more than 1e-9."""
    if isinstance(official, dict):
        return [d for k, v in official.items() for d in differences(ours[k], v, f"{where}.{k}")]
    if isinstance(official, list):
        return [d for k, v in enumerate(official) for d in differences(ours[k], v, f"{where}[{k}]")]
    if not isinstance(official, int | float):
        return [] if ours == official else [f"{where}: {ours} for {official}"]
    if math.isnan(official) and math.isnan(ours):
        return []
    names = where.replace("[", ".").split(".")
    tolerance = 0.0 if COUNTS.intersection(names) else 1e-9
    return [] if abs(ours - official) <= tolerance else [f"{where}: {ours} for {official}"]


DUPLICATES = "more matched scores than true boxes, as an identity is twice in a frame: it asserts"
NOTHING = "no box is left to evaluate"


def devkit_metrics(data: Path, out: Path) -> tuple[dict[str, Any], dict[str, Any]] | str:
    """The official summary and details, or why the devkit refuses."""
    try:
        return evaluate_folder(data, out)
    except AssertionError:
        return DUPLICATES
    except Exception as error:
        if "Invalid box type" in str(error):
            return NOTHING
        raise


@pytest.mark.parametrize("seed", range(SCENARIOS))
def test_random_scenarios_equal_the_devkit(
    seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MOTTRACK_CACHE", str(tmp_path / "cache"))
    data, out = tmp_path / "data", tmp_path / "out"
    rules = Rules(arithmetic="machine")  # the devkit's product is this processor's
    request = command.Request(
        data, "v1.0-trainval", str(data / "scenes.txt"), data / "submission.json", rules
    )
    Scenario(seed).write(data)
    official = devkit_metrics(data, out)
    if official == DUPLICATES:
        assert any(p.field == "tracking_id" for p in command.run(request).problems)
        Scenario(seed, duplicates=False).write(data)
        official = devkit_metrics(data, out)
    if official == NOTHING:
        with pytest.raises(MottrackError):
            command.run(request)
        return
    assert isinstance(official, tuple), official
    summary, details = official
    evaluation = command.run(request)
    ours = summary_json(evaluation.metrics, evaluation.meta, 0.0)
    summary.pop("eval_time")
    assert differences(ours, summary) == []
    assert differences(details_json(evaluation.metrics), details) == []


def peer_data(pairs: Pairs) -> dict[str, Any]:
    """A sequence as trackeval wants it."""
    truth, tracks = pairs.truth.dense_ids(), pairs.tracks.dense_ids()
    data: dict[str, Any] = {"gt_ids": [], "tracker_ids": [], "similarity_scores": []}
    for rows in pairs.by_frame():
        data["gt_ids"].append(truth[rows.truth])
        data["tracker_ids"].append(tracks[rows.tracks])
        data["similarity_scores"].append(pairs.matrix(rows, pairs.similarity, 0.0))
    return data | {
        "num_gt_ids": int(truth.max(initial=-1)) + 1,
        "num_tracker_ids": int(tracks.max(initial=-1)) + 1,
        "num_gt_dets": len(truth),
        "num_tracker_dets": len(tracks),
        "num_timesteps": pairs.frames,
    }


def assert_as_trackeval(pairs: Pairs) -> None:
    data = peer_data(pairs)
    ours, peer = hota.hota(hota.hota_counts(pairs)), HOTA().eval_sequence(data)
    names = {
        "hota": "HOTA",
        "det_a": "DetA",
        "ass_a": "AssA",
        "loc_a": "LocA",
        "det_re": "DetRe",
        "det_pr": "DetPr",
        "ass_re": "AssRe",
        "ass_pr": "AssPr",
    }
    for name, theirs in names.items():
        np.testing.assert_allclose(getattr(ours, name), peer[theirs], atol=1e-9, rtol=0)
    near = pairs.within(iou_gate(0.5))
    ids = Identity({"THRESHOLD": 0.5, "PRINT_CONFIG": False}).eval_sequence(data)
    assert identity.identity_counts(near).idf1 == pytest.approx(ids["IDF1"], abs=1e-9)


@pytest.mark.parametrize("name", ["TUD-Campus", "TUD-Stadtmitte"])
def test_tud_equals_trackeval_and_motmetrics(name: str) -> None:
    import motmetrics

    folder = SHARED / "motchallenge_tud" / name
    if not folder.is_dir():
        pytest.skip("no recorded data here")
    boxes = preprocess(read_boxes(folder / "gt.txt"), read_boxes(folder / "test.txt"), 0.5)
    pairs = image_pairs(*boxes)
    assert_as_trackeval(pairs)
    near = pairs.within(iou_gate(0.5))
    assert_as_motmetrics(near, motmetrics)
    peer = CLEAR({"THRESHOLD": 0.5, "PRINT_CONFIG": False}).eval_sequence(peer_data(pairs))
    assert clear.clear_counts(near, clear.associate(near)).mota == pytest.approx(
        peer["MOTA"], abs=2e-2
    )


def assert_as_motmetrics(near: Pairs, motmetrics: Any) -> None:
    accumulator = motmetrics.MOTAccumulator(auto_id=True)
    truth, tracks = near.truth.dense_ids(), near.tracks.dense_ids()
    for rows in near.by_frame():
        distance = near.matrix(rows, near.distance, np.nan)
        accumulator.update(truth[rows.truth], tracks[rows.tracks], distance)
    names = ["mota", "motp", "idf1", "num_switches", "num_fragmentations", "num_false_positives"]
    names += ["num_misses", "mostly_tracked", "mostly_lost"]
    peer = motmetrics.metrics.create().compute(accumulator, metrics=names).iloc[0]
    counts = clear.clear_counts(near, clear.associate(near))
    assert counts.mota == pytest.approx(peer["mota"], abs=1e-12)
    assert counts.motp == pytest.approx(peer["motp"], abs=1e-12)
    assert identity.identity_counts(near).idf1 == pytest.approx(peer["idf1"], abs=1e-12)
    assert counts.switches == peer["num_switches"]
    assert counts.fragmentations == peer["num_fragmentations"]
    assert (counts.false_positives, counts.misses) == (
        peer["num_false_positives"],
        peer["num_misses"],
    )
    assert (counts.mostly_tracked, counts.mostly_lost) == (
        peer["mostly_tracked"],
        peer["mostly_lost"],
    )


@pytest.mark.parametrize("seed", range(20))
def test_random_sequences_equal_trackeval_and_motmetrics(seed: int) -> None:
    import motmetrics

    rng = np.random.default_rng(seed)
    frames = int(rng.integers(5, 30))
    sides = []
    for chance in (0.9, 0.8):
        there = rng.random((frames, 6)) < chance
        frame, number = np.nonzero(there)
        sides.append(
            (BoxStream(frame, number), rng.normal(0, 0.25, (len(frame), 2)) + number[:, None])
        )

    def measure(rows: slice, columns: slice) -> Measured:
        apart = sides[0][1][rows, None] - sides[1][1][None, columns]
        similarity = np.maximum(0.0, 1.0 - np.linalg.norm(apart, axis=2))
        return Measured(1.0 - similarity, similarity)

    spans = (np.zeros((len(side), 2)) for side, _ in sides)
    pairs = find_pairs(sides[0][0], sides[1][0], frames, Measure(measure, *spans))
    assert_as_trackeval(pairs)
    assert_as_motmetrics(pairs.within(iou_gate(0.5)), motmetrics)


def test_official_loader_reads_our_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from nuscenes.eval.tracking.data_classes import (
        TrackingMetricData,
        TrackingMetricDataList,
        TrackingMetrics,
    )

    monkeypatch.setenv("MOTTRACK_CACHE", str(tmp_path / "cache"))
    data = tmp_path / "data"
    Scenario(1).write(data)
    request = command.Request(
        data, "v1.0-trainval", str(data / "scenes.txt"), data / "submission.json"
    )
    command.write(command.run(request), tmp_path / "out")
    summary = json.loads((tmp_path / "out/metrics_summary.json").read_text())
    details = json.loads((tmp_path / "out/metrics_details.json").read_text())
    metrics = TrackingMetrics.deserialize(summary)
    assert set(metrics.label_metrics) == set(summary["label_metrics"])
    TrackingMetricData.set_nelem(40)
    assert TrackingMetricDataList.deserialize(details, TrackingMetricData)["car"] is not None

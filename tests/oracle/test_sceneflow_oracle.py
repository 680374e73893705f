"""Scene flow beside the two official packages: `av2` and `bucketed-scene-flow-eval`."""

import json
import os
import sys
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

from mottrack.eval.sceneflow.categories import CATEGORIES, GROUPS
from mottrack.eval.sceneflow.figures import SceneSums
from mottrack.eval.sceneflow.files import all_points, write_annotation, write_prediction
from mottrack.eval.sceneflow.points import FlowPoints
from mottrack.eval.sceneflow.sums import frame_sums, total

DEFAULT = Path(__file__).resolve().parents[3] / "shared/data"
SHARED = Path(os.environ.get("MOTTRACK_SHARED_DATA", DEFAULT))


def made_points(seed: int) -> FlowPoints:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4000))
    xy_m = rng.uniform(-50, 50, (n, 2))
    ego_m = np.column_stack([rng.normal(0.8, 0.05, n), rng.normal(0, 0.05, n), np.zeros(n)])
    category = np.where(rng.random(n) < 0.6, 0, rng.integers(0, len(CATEGORIES), n))
    moving = (category > 0) & (rng.random(n) < 0.5)
    own = rng.exponential(0.6, n)[:, None] * np.array([[1.0, 0.3, 0.0]]) * moving[:, None]
    noise = rng.normal(0, rng.choice([0.01, 0.05, 0.3]), (n, 3)) * (rng.random((n, 1)) < 0.7)
    dynamic = np.linalg.norm(own, axis=1) >= 0.05
    said = own * rng.choice([0.0, 0.9, 1.0], (n, 1)) + noise
    return FlowPoints(
        ego_m + own,
        ego_m + said,
        category,
        dynamic,
        np.linalg.norm(said, axis=1) >= 0.05,
        np.abs(xy_m).max(axis=1) <= 35,
        rng.random(n) < 0.95,
        ego_m,
        xy_m,
    )


@pytest.mark.parametrize("seed", range(8))
def test_files_equal_av2(seed: int, tmp_path: Path) -> None:
    from av2.evaluation.scene_flow.eval import evaluate_directories, results_to_dict

    for number in range(3):
        points, name = made_points(10 * seed + number), f"log{number % 2}/{number}.feather"
        write_annotation(tmp_path / "truth", name, points)
        write_prediction(tmp_path / "said", name, points)
    official = results_to_dict(evaluate_directories(tmp_path / "truth", tmp_path / "said"))
    scenes = [
        total([frame_sums(p) for p in all_points(tmp_path / "truth", tmp_path / "said", log)])
        for log in ("log0", "log1")
    ]
    ours = SceneSums(tuple(scenes)).values()
    found = {name: ours["official", name] for name in official}
    assert found == pytest.approx(official, abs=1e-9, nan_ok=True)
    assert {name for table, name in ours if table == "official"} == set(official)


def bucketed_package() -> Any:
    """The evaluators; the package imports its viewer, which is not installed here."""
    sys.modules.setdefault("open3d", MagicMock())
    import bucketed_scene_flow_eval.eval as package

    return package


def official_bucketed(sweeps: list[FlowPoints], kind: str, out: Path) -> dict[str, Any]:
    package = bucketed_package()
    from bucketed_scene_flow_eval.datastructures import (
        EgoLidarFlow,
        PointCloud,
        PoseInfo,
        SupervisedPointCloudFrame,
        TimeSyncedSceneFlowFrame,
    )

    groups = dict(GROUPS)
    if kind == "threeway":
        moving = tuple(name for row in list(GROUPS.values())[1:] for name in row)
        groups = {"BACKGROUND": GROUPS["BACKGROUND"], "FOREGROUND": moving}
    classes = dict(enumerate(CATEGORIES))
    maker = {"bucketed": package.BucketedEPEEvaluator, "threeway": package.ThreeWayEPEEvaluator}
    evaluator = maker[kind](
        class_id_to_name=classes,
        meta_class_lookup={k: list(v) for k, v in groups.items()},
        output_path=out,
    )
    for index, points in enumerate(sweeps):
        assert points.xy_m is not None
        assert points.ego_motion_m is not None
        cloud = PointCloud(np.column_stack([points.xy_m, np.zeros(len(points.xy_m))]))
        everywhere = np.ones(len(points.xy_m), bool)
        frame = SupervisedPointCloudFrame(
            cloud, PoseInfo.identity(), everywhere, points.category.astype(np.int8)
        )
        truth = EgoLidarFlow(points.truth_m - points.ego_motion_m, points.valid)
        said = EgoLidarFlow(points.estimate_m - points.ego_motion_m, points.valid.copy())
        labelled = TimeSyncedSceneFlowFrame(
            pc=frame, auxillary_pc=None, rgbs=None, log_id="log", log_idx=index,
            log_timestamp=index, flow=truth,
        )  # fmt: skip
        evaluator.eval(said, labelled)
    found: dict[str, Any] = evaluator.compute_results(save_results=False)
    return found


def assert_as_bucketed(sweeps: list[FlowPoints], out: Path) -> None:
    ours = SceneSums((total([frame_sums(p) for p in sweeps]),)).values()
    for name, official in official_bucketed(sweeps, "bucketed", out).items():
        found = [ours["bucketed", f"{name} {kind}"] for kind in ("static", "dynamic")]
        assert found == pytest.approx(list(official), abs=1e-9, nan_ok=True), name
    mean = json.loads((out / "mean_average_results_35.json").read_text())
    found = [ours["bucketed", f"mean {kind}"] for kind in ("static", "dynamic")]
    assert found == pytest.approx(mean, abs=1e-9, nan_ok=True)
    three = official_bucketed(sweeps, "threeway", out / "threeway")
    official = [three["BACKGROUND"][0], *three["FOREGROUND"]]
    names = ("background static", "foreground static", "foreground dynamic")
    found = [ours["threeway", name] for name in names]
    assert found == pytest.approx(official, abs=1e-9, nan_ok=True)


@pytest.mark.parametrize("seed", range(8))
def test_made_pairs_equal_the_bucketed_package(seed: int, tmp_path: Path) -> None:
    assert_as_bucketed([made_points(100 * seed + k) for k in range(3)], tmp_path)


def test_recorded_pair_equals_both_packages(tmp_path: Path) -> None:
    from av2.evaluation.scene_flow import eval as av2
    from av2.evaluation.scene_flow.constants import FOREGROUND_BACKGROUND_BREAKDOWN

    path = SHARED / "flow_pairs/argoverse2_icpflow_demo.npz"
    if not path.is_file():
        pytest.skip("no recorded data here")
    with np.load(path) as pair:
        truth = np.nan_to_num(pair["flow0_m"].astype(np.float64))
        said = np.nan_to_num(pair["peer_flow0_m"].astype(np.float64))
        xy_m, near = pair["points0"][:, :2].astype(np.float64), pair["near0"]
        category = np.maximum(pair["class0"].astype(np.int64), 0)
    points = FlowPoints(
        truth,
        said,
        category,
        np.linalg.norm(truth, axis=1) >= 0.05,
        np.linalg.norm(said, axis=1) >= 0.05,
        np.abs(xy_m).max(axis=1) <= 35,
        near,
        np.zeros_like(truth),
        xy_m,
    )
    assert_as_bucketed([points], tmp_path)
    rows = av2.compute_metrics(
        said, points.dynamic_estimate, truth, category, points.dynamic, points.close, near,
        FOREGROUND_BACKGROUND_BREAKDOWN,
    )  # fmt: skip
    sums = frame_sums(points).official
    for k, count in enumerate(rows["Count"]):
        side = [rows[n][k] for n in ("Class", "Motion", "Distance")]
        place = tuple(int(s in ("Foreground", "Dynamic", "Close")) for s in side)
        assert sums[place][0] == count
        if count:
            official = [rows[n][k] for n in ("ACCURACY_STRICT", "ACCURACY_RELAX", "ANGLE_ERROR")]
            assert (sums[place][1:4] / count).tolist() == pytest.approx(official, abs=1e-9)
            assert sums[place][4] / count == pytest.approx(rows["EPE"][k], abs=1e-9)

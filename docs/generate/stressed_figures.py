"""Measure every figure of `metric_info` under four damages, for the table of docs/figures.md.

    python docs/generate/stressed_figures.py

The damages are those of `mottrack stress`, on two scenes of the embedded world.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mottrack.core import SceneResult
from mottrack.eval.argoverse2 import boxes as argoverse2
from mottrack.eval.argoverse2.metrics import evaluate as evaluate_argoverse2
from mottrack.eval.argoverse2.rules import CATEGORIES
from mottrack.eval.evaluation import score
from mottrack.eval.metric_info import FLOW, PROTOCOLS, TRACKING, VELOCITY
from mottrack.eval.nuscenes.metrics import evaluate_prepared
from mottrack.eval.nuscenes.prepare import prepare_results, rules_for
from mottrack.eval.waymo import boxes as waymo
from mottrack.eval.waymo.metrics import evaluate as evaluate_waymo
from mottrack.experiment.experiment import Experiment, load_experiments
from mottrack.pipeline.scene_run import run_scene
from mottrack.studies.stress.stressed import Stress, StressedScene
from mottrack.studies.stress.study import StressedPart

WORDS = ("flow=icp", "tracker=kalman", "dataset.scenes=2", "dataset.duration_s=6")
STEPS = (
    Stress("", 0.0),
    Stress("dropout", 0.4),
    Stress("jitter", 1.0),
    Stress("clutter", 10.0),
    Stress("flow_noise", 2.0),
)


def figures(experiment: Experiment, stress: Stress) -> dict[str, float]:
    """Return every figure of a run under one damage."""
    flow = experiment.flow
    part = StressedPart(flow.kind, flow.cls, flow.config, stress)
    dataset = experiment.dataset.make()
    scenes = [StressedScene(dataset.scene(name), stress) for name in dataset.scene_names]
    stressed = replace(experiment, flow=part)
    results = [run_scene(stressed, scene, keep_snapshots=False).result for scene in scenes]
    scores = score(results, experiment.settings.scores)
    tracking, velocity, flows = scores.overall.as_dict(), scores.velocity["all"], scores.flow["all"]
    shown = [info.key for info in (*TRACKING, *PROTOCOLS) if info.key in tracking]
    found = {key: float(tracking[key]) for key in shown} | of_protocols(results)
    found |= {info.key: getattr(velocity, info.key) for info in VELOCITY}
    return found | {info.key: getattr(flows, info.key) for info in FLOW}


def of_protocols(results: Sequence[SceneResult]) -> dict[str, float]:
    """Return the figures of other protocols, of cars where a protocol has no mean of classes."""
    rules = rules_for(results[0].classes)
    official = evaluate_prepared(prepare_results(results, rules), rules).total
    logs, segments = zip(*(as_other_data(result) for result in results), strict=True)
    cars = evaluate_argoverse2(logs)["REGULAR_VEHICLE"].figures()
    vehicles = evaluate_waymo(segments)["VEHICLE", 2]
    own = {"argoverse2_amota": cars["amota"], "waymo_mota": vehicles.mota}
    return own | {name: official[name] for name in ("motar", "tid")}


def as_other_data(result: SceneResult) -> tuple[argoverse2.Log, waymo.Segment]:
    """Return the cars of a scene as a log and as a segment."""
    ego_m = result.frames.world_T_ego[:, :3, 3]
    logs, segments = [], []
    for table in (result.truth, result.tracks):
        own = table.select(np.argsort(table.frame, kind="stable"))
        own = own.select(own.label == "car")
        score = getattr(own, "score", np.zeros(len(own)))
        kind = np.full(len(own), CATEGORIES.index("REGULAR_VEHICLE"))
        xy_m = np.ascontiguousarray(own.centre_m[:, :2])
        logs.append(argoverse2.LogBoxes(own.frame, own.id, kind, xy_m, score))
        # shifted, not turned: overlaps and ranges are the same
        box = np.column_stack([own.centre_m - ego_m[own.frame], own.size_m, own.yaw_rad])
        none = np.zeros(len(own), np.int64)
        segments.append(waymo.SegmentBoxes(own.frame, own.id, none + 1, box, score, none, none > 0))
    return argoverse2.Log(result.name, ego_m[:, :2], *logs), waymo.Segment(
        result.name, len(ego_m), *segments
    )


def main() -> None:
    """Print the rows of the table."""
    (experiment,) = load_experiments("demo", list(WORDS))
    found = [figures(experiment, stress) for stress in STEPS]
    for info in (*TRACKING, *VELOCITY, *FLOW, *PROTOCOLS):
        if info.key not in found[0]:
            continue  # KITTI's protocol needs boxes in the image
        cells = " | ".join(info.text(row[info.key]) for row in found)
        sys.stdout.write(f"| [{info.name}](#{info.key}) | {cells} |\n")


if __name__ == "__main__":
    main()

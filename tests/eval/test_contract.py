"""Properties that every evaluation has: one test body over a table of evaluations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from mottrack.core import FlowSamples, FrameTable, InputError, SceneResult, TrackTable, TruthTable
from mottrack.eval import clear, hota, identity, mot
from mottrack.eval.evaluation import BATCH, score
from mottrack.eval.flow_error import cell_errors, flow_table
from mottrack.eval.kitti import levels, matching
from mottrack.eval.kitti.boxes import KittiBoxes
from mottrack.eval.nuscenes.metrics import evaluate_prepared
from mottrack.eval.nuscenes.prepare import prepare_results, rules_for
from mottrack.eval.scores import ScoreConfig, ScoreFilter, scene_scores
from mottrack.eval.velocity_error import velocity_samples, velocity_table

FRAMES, OBJECTS = 6, 5
CONFIG = ScoreConfig()
Metrics = dict[str, float]
Scenes = list[SceneResult]


@dataclass(frozen=True)
class Evaluation:
    """An evaluation of scenes and the scores that it must give."""

    run: Callable[[Scenes], Metrics]
    perfect: Metrics
    worst: Metrics | None
    """Without any track; None: it refuses to evaluate nothing."""
    add_up: tuple[str, ...]
    """Counts of scenes apart that give those of the scenes together."""
    weighted: dict[str, str] = field(default_factory=dict)
    """Scores whose mean over scenes, weighted by a count, is that of the scenes together. AMOTA and
    sAMOTA are none: their thresholds depend on all scenes."""


def velocity(scenes: Scenes) -> Metrics:
    row = velocity_table([velocity_samples(scene) for scene in scenes])["all"]
    return {"count": row.count, "mean": row.mean_mps, "worst": row.worst_mean_mps}


def flow(scenes: Scenes) -> Metrics:
    row = flow_table([scene.flow for scene in scenes])["all"]
    return {"cells": row.cells, "rmse": row.rmse_m, "aae": row.aae_rad, "measured": row.measured}


def _parts(scenes: Scenes) -> list:
    return [scene_scores(scene, ScoreFilter(""), CONFIG) for scene in scenes]


def clear_mot(scenes: Scenes) -> Metrics:
    c = clear.total(part.clear for part in _parts(scenes))
    counts = {"truth": c.truth, "misses": c.misses, "switches": c.switches, "hits": c.hits}
    return counts | {"mota": c.mota, "motp": c.motp, "mostly_tracked": c.mostly_tracked}


def identities(scenes: Scenes) -> Metrics:
    c = identity.total(part.identity for part in _parts(scenes))
    return {"idtp": c.true_positives, "truth": c.truth, "idf1": c.idf1}


def higher_order(scenes: Scenes) -> Metrics:
    sums = hota.total(part.hota for part in _parts(scenes))
    metrics = hota.hota(sums).as_dict()
    return {
        "tp": float(sums.true_positives.sum()),
        "hota": metrics["hota"],
        "assa": metrics["ass_a"],
    }


def nuscenes(scenes: Scenes) -> Metrics:
    rules = rules_for(["car"])
    total = evaluate_prepared(prepare_results(scenes, rules), rules).total
    return {name: total[name] for name in ("amota", "amotp", "mota", "recall", "ids", "fn", "gt")}


def _kitti_boxes(table: TruthTable | TrackTable) -> KittiBoxes:
    n = len(table)
    order = np.lexsort((table.id, table.frame))
    box = np.column_stack([table.centre_m, table.size_m, table.yaw_rad])
    ones = np.ones(n)
    return KittiBoxes(
        frame=table.frame,
        id=table.id,
        kind=np.full(n, "car"),
        truncation=0 * ones,
        occlusion=0 * ones,
        image_box=np.tile([0.0, 0.0, 100.0, 100.0], (n, 1)),
        box=box,
        score=table.score if isinstance(table, TrackTable) else ones,
    ).select(order)


def kitti(scenes: Scenes) -> Metrics:
    rules = matching.KittiRules()
    sequences = [
        matching.prepare(_kitti_boxes(s.truth), _kitti_boxes(s.tracks), rules) for s in scenes
    ]
    metrics = levels.evaluate(sequences, rules)
    counts = metrics.best.counts
    found = {"truth": counts.truth, "tp": counts.tp, "fn": counts.fn, "ids": counts.ids}
    return found | {"mota": metrics.best.mota, "samota": metrics.samota, "motp": metrics.best.motp}


def _mot_boxes(table: TruthTable | TrackTable, scene: SceneResult) -> mot.MotBoxes:
    """The boxes in the frame of the vehicle, whose axes are those of the image: 10 px a metre."""
    table = table.select(np.argsort(table.frame, kind="stable"))
    world_T_ego = scene.frames.world_T_ego[table.frame]
    apart = table.centre_m - world_T_ego[:, :3, 3]
    xy = np.einsum("nij,ni->nj", world_T_ego[:, :3, :2], apart)
    corner = np.round(10 * (xy - 1.0), 6)
    ones = np.ones(len(table))
    return mot.MotBoxes(
        table.frame, table.id, np.hstack([corner, corner + 20.0]), ones, np.full(len(table), -1)
    )


def mot_challenge(scenes: Scenes) -> Metrics:
    parts = [mot.score_boxes(_mot_boxes(s.truth, s), _mot_boxes(s.tracks, s)) for s in scenes]
    row = mot.together(parts).as_dict()
    return {n: row[n] for n in ("truth", "fn", "ids", "mota", "idf1", "hota")}


EVALUATIONS = {
    "velocity error": Evaluation(
        velocity, {"mean": 0.0, "worst": 0.0}, {"count": 0}, ("count",), {"mean": "count"}
    ),
    "flow error": Evaluation(
        flow, {"rmse": 0.0, "aae": 0.0}, {"measured": 0.0}, ("cells",), {"aae": "cells"}
    ),
    "CLEAR": Evaluation(
        clear_mot,
        {"mota": 1.0, "motp": 0.0, "switches": 0},
        {"mota": 0.0, "hits": 0},
        ("truth", "misses", "switches", "hits", "mostly_tracked"),
        {"mota": "truth", "motp": "hits"},
    ),
    "identity": Evaluation(identities, {"idf1": 1.0}, {"idf1": 0.0}, ("idtp", "truth")),
    "HOTA": Evaluation(higher_order, {"hota": 1.0, "assa": 1.0}, {"hota": 0.0}, ("tp",)),
    "nuScenes": Evaluation(
        nuscenes, {"amota": 1.0, "amotp": 0.0, "mota": 1.0, "ids": 0}, None, ("gt",)
    ),
    "KITTI": Evaluation(
        kitti, {"mota": 1.0, "motp": 1.0, "ids": 0}, {"mota": 0.0, "samota": 0.0}, ("truth",)
    ),
    "MOT": Evaluation(
        mot_challenge,
        {"mota": 1.0, "idf1": 1.0, "hota": 1.0},
        {"mota": 0.0, "idf1": 0.0, "hota": 0.0},
        ("truth", "fn", "ids"),
        {"mota": "truth"},
    ),
}


@pytest.fixture(params=EVALUATIONS.values(), ids=EVALUATIONS.keys())
def evaluation(request: pytest.FixtureRequest) -> Evaluation:
    found: Evaluation = request.param
    return found


def table_of(kind: type, frame: np.ndarray, identity_: np.ndarray, centre: np.ndarray):
    n = len(frame)
    columns = {
        "frame": frame,
        "id": identity_,
        "label": np.full(n, "car"),
        "centre_m": np.column_stack([centre, np.ones(n)]),
        "size_m": np.tile([4.0, 2.0, 1.5], (n, 1)),
        "yaw_rad": np.zeros(n),
        "velocity_mps": np.tile([1.0, 0.5], (n, 1)),
    }
    if kind is TruthTable:
        return TruthTable(**columns, num_points=np.full(n, 5), interpolated=np.zeros(n, bool))
    return TrackTable(
        **columns,
        velocity_covariance_m2ps2=np.tile(np.eye(2), (n, 1, 1)),
        score=0.5 + 0.01 * (identity_ % 40),
        observed=np.ones(n, bool),
        hull_corners=np.zeros(n, np.int64),
    )


def make_scene(seed: int, *, perfect: bool = False) -> SceneResult:
    """Objects on straight lines 12 m apart; tracks with noise, gaps, a switch and a false one."""
    rng = np.random.default_rng(seed)
    frame, number = (a.ravel() for a in np.mgrid[:FRAMES, :OBJECTS])
    centre = np.column_stack([1.0 * frame, 12.0 * number - 24.0])
    truth = table_of(TruthTable, frame, number, centre)
    kept = np.arange(len(frame)) if perfect else rng.permutation(len(frame))[:-4]
    kept.sort()
    noise = 0.0 if perfect else 0.25
    renamed = number + 10 + (0 if perfect else 20 * ((number == 2) & (frame >= 3)))
    tracks = table_of(
        TrackTable, frame[kept], renamed[kept], centre[kept] + rng.normal(0, noise, (len(kept), 2))
    )
    if not perfect:
        false = table_of(TrackTable, np.arange(3), np.full(3, 39), np.full((3, 2), 30.0))
        tracks = TrackTable.stacked([tracks, false])
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[:, 0, 3] = np.arange(FRAMES)
    angle = np.tile([-np.pi, np.pi], (FRAMES, 1))
    frames = FrameTable(
        np.arange(FRAMES) * 500_000_000,
        np.array([f"{seed}-{f}" for f in range(FRAMES)]),
        poses,
        angle,
        np.ones(FRAMES, bool),
    )
    return SceneResult(f"scene {seed}", frames, truth, tracks, make_flow(rng, perfect))


def make_flow(rng: np.random.Generator, perfect: bool) -> FlowSamples:
    truth = rng.normal(0, 2, (20, 2)).astype(np.float32)
    error = np.zeros_like(truth) if perfect else rng.normal(0, 0.5, truth.shape)
    return FlowSamples(
        frame=np.arange(20) % FRAMES,
        xy_m=rng.uniform(-20, 20, (20, 2)).astype(np.float32),
        estimate_mps=(truth + error).astype(np.float32),
        truth_mps=truth,
        dt_s=np.full(20, 0.1, np.float32),
        valid=np.ones(20, bool),
        dynamic=np.arange(20) % 2 == 0,
        movable=np.arange(20) % 2 == 0,
        observable=np.ones(20, bool),
    )


def shuffled(scene: SceneResult) -> SceneResult:
    rng = np.random.default_rng(0)
    parts = {
        name: table.select(rng.permutation(len(table)))
        for name, table in (("truth", scene.truth), ("tracks", scene.tracks), ("flow", scene.flow))
    }
    return replace(scene, **parts)


def renamed(scene: SceneResult) -> SceneResult:
    """Other identities, in another order."""
    return replace(
        scene,
        truth=replace(scene.truth, id=97 - scene.truth.id),
        tracks=replace(scene.tracks, id=1000 - 7 * scene.tracks.id),
    )


def moved(scene: SceneResult) -> SceneResult:
    """The whole world rotated and shifted."""
    angle = 2.0
    T = np.eye(4)
    T[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    T[:3, 3] = [30.0, -70.0, 2.0]

    def table(t):
        return replace(
            t,
            centre_m=t.centre_m @ T[:3, :3].T + T[:3, 3],
            yaw_rad=t.yaw_rad + angle,
            velocity_mps=t.velocity_mps @ T[:2, :2].T,
        )

    frames = replace(scene.frames, world_T_ego=T @ scene.frames.world_T_ego)
    return replace(scene, frames=frames, truth=table(scene.truth), tracks=table(scene.tracks))


def without_tracks(scene: SceneResult) -> SceneResult:
    flow_ = scene.flow
    nothing = replace(
        flow_, estimate_mps=np.zeros_like(flow_.estimate_mps), valid=np.zeros(len(flow_), bool)
    )
    return replace(scene, tracks=TrackTable.empty(), flow=nothing)


def empty_scene() -> SceneResult:
    scene = make_scene(99)
    return replace(
        scene, truth=TruthTable.empty(), tracks=TrackTable.empty(), flow=FlowSamples.empty()
    )


def some_scenes() -> Scenes:
    return [make_scene(seed) for seed in (1, 2)]


def assert_same(found: Metrics, expected: Metrics) -> None:
    assert found == pytest.approx(expected, abs=1e-6, nan_ok=True)


@pytest.mark.parametrize("change", [shuffled, renamed, moved])
def test_invariance(evaluation: Evaluation, change: Callable[[SceneResult], SceneResult]) -> None:
    scenes = some_scenes()
    expected = evaluation.run(scenes)
    assert_same(evaluation.run([change(scene) for scene in scenes]), expected)


def test_the_scenes_of_this_file_are_not_perfect(evaluation: Evaluation) -> None:
    found = evaluation.run(some_scenes())
    for name, best in evaluation.perfect.items():
        assert found[name] != pytest.approx(best, abs=1e-3), name


def test_perfect_tracks_give_the_perfect_score(evaluation: Evaluation) -> None:
    found = evaluation.run([make_scene(seed, perfect=True) for seed in (1, 2)])
    assert_same({name: found[name] for name in evaluation.perfect}, evaluation.perfect)


def test_no_tracks_give_the_worst_score(evaluation: Evaluation) -> None:
    scenes = [without_tracks(scene) for scene in some_scenes()]
    if evaluation.worst is None:
        with pytest.raises(InputError, match="at least one box to evaluate"):
            evaluation.run(scenes)
        return
    found = evaluation.run(scenes)
    assert_same({name: found[name] for name in evaluation.worst}, evaluation.worst)


def test_counts_of_scenes_apart_add_up(evaluation: Evaluation) -> None:
    scenes = some_scenes()
    together = evaluation.run(scenes)
    apart = [evaluation.run([scene]) for scene in scenes]
    for name in evaluation.add_up:
        assert together[name] == sum(part[name] for part in apart), name


def test_scores_of_scenes_together_are_weighted_means(evaluation: Evaluation) -> None:
    scenes = some_scenes()
    together = evaluation.run(scenes)
    apart = [evaluation.run([scene]) for scene in scenes]
    for name, weight in evaluation.weighted.items():
        mean = sum(p[name] * p[weight] for p in apart) / sum(p[weight] for p in apart)
        assert together[name] == pytest.approx(mean), name


def test_an_empty_scene_changes_nothing(evaluation: Evaluation) -> None:
    scenes = some_scenes()
    assert_same(evaluation.run([*scenes, empty_scene()]), evaluation.run(scenes))


def of_two_classes(scene: SceneResult) -> SceneResult:
    """Every other object is a pedestrian."""
    truth, tracks = scene.truth, scene.tracks
    return replace(
        scene,
        truth=replace(truth, label=np.where(truth.id % 2, "car", "pedestrian")),
        tracks=replace(tracks, label=np.where(tracks.id % 2, "car", "pedestrian")),
    )


def test_scene_by_scene_the_figures_are_those_of_all_at_once_to_the_last_bit() -> None:
    """More scenes than are prepared together, and some of them empty."""
    scenes = [of_two_classes(make_scene(seed)) for seed in range(2 * BATCH)]
    scenes += 2 * [empty_scene()]
    found = score(scenes)
    rules = rules_for(["car", "pedestrian"])
    official = evaluate_prepared(prepare_results(scenes, rules), rules)
    for name, expected in official.classes.items():
        own = found.classes[name]
        assert (own.amota, own.amotp_m) == (expected["amota"], expected["amotp"])
    assert found.overall.amota == official.total["amota"]
    errors = np.concatenate([velocity_samples(scene).error_mps for scene in scenes])
    row = found.velocity["all"]
    assert (row.mean_mps, row.median_mps) == (errors.mean(), np.median(errors))
    assert row.percentile_95_mps == np.quantile(errors, 0.95)
    assert row.worst_mean_mps == np.sort(errors)[-round(0.05 * len(errors)) :].mean()
    cells = cell_errors(FlowSamples.stacked([scene.flow for scene in scenes]))
    flow_row = found.flow["all"]
    assert flow_row.median_mps == np.median(cells.speed_mps)
    assert flow_row.aae_rad == cells.angle_rad.mean()
    assert flow_row.rmse_m == np.sqrt((cells.length_m**2).mean())

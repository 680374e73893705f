"""The official metrics of stored scene results, whatever data set they come from."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mottrack.core import SceneResult
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.eval.nuscenes.boxes import BoxTable, GroundTruth, Prepared, Racks, Samples
from mottrack.eval.nuscenes.prepare import prepare
from mottrack.eval.nuscenes.rules import RANGES_M, Rules
from mottrack.eval.nuscenes.summary import Metrics, evaluate_prepared

FAR_M = 1e4
"""No map of nuScenes reaches this far: its results are evaluated bit for bit as official."""


def result_metrics(results: Sequence[SceneResult], rules: Rules) -> Metrics:
    """AMOTA and its company over all scenes together.

    Raises:
        InputError: no true or no tracked box is left to evaluate.
    """
    return evaluate_prepared(prepare_results(results, rules), rules)


def prepare_results(results: Sequence[SceneResult], rules: Rules) -> Prepared:
    """Truth and tracks of the scenes, filtered and filled as the official evaluation does.

    Raises:
        InputError: no true or no tracked box is left to evaluate.
    """
    results = [_near_origin(result) for result in results]
    offsets = np.concatenate([[0], np.cumsum([len(r.frames) for r in results])])
    truth = [_boxes(r.truth, o, rules) for r, o in zip(results, offsets, strict=False)]
    tracks = [_boxes(r.tracks, o, rules) for r, o in zip(results, offsets, strict=False)]
    samples = Samples(
        scene_name=np.array([r.name for r in results], dtype=np.str_),
        first=offsets,
        token=np.concatenate([r.frames.token for r in results]),
        stamp_us=np.concatenate([r.frames.stamp_ns for r in results]) // 1000,
        ego_xy_m=np.concatenate([r.frames.world_T_ego[:, :2, 3] for r in results]),
    )
    return prepare(GroundTruth(samples, _merged(truth), _no_racks()), _merged(tracks), rules)


def _near_origin(result: SceneResult) -> SceneResult:
    """The scene shifted by whole metres if it lies more than `FAR_M` from the world's origin.

    The official distance is a difference of squared coordinates: at 4e6 m it is off by up to 9 cm.
    """
    world_T_ego = result.frames.world_T_ego
    if np.abs(world_T_ego[:, :2, 3]).max(initial=0.0) <= FAR_M:
        return result
    origin_m = np.round(world_T_ego[0, :3, 3])
    moved = world_T_ego.copy()
    moved[:, :3, 3] -= origin_m
    return replace(
        result,
        frames=replace(result.frames, world_T_ego=moved),
        truth=replace(result.truth, centre_m=result.truth.centre_m - origin_m),
        tracks=replace(result.tracks, centre_m=result.tracks.centre_m - origin_m),
    )


def rules_for(classes: Sequence[str]) -> Rules:
    """The official ranges where every class has one, else no limit of range."""
    if all(name in RANGES_M for name in classes):
        return Rules(tuple(classes), tuple(float(RANGES_M[name]) for name in classes))
    return Rules.for_classes(tuple(classes))


def _boxes(table: TruthTable | TrackTable, offset: int, rules: Rules) -> BoxTable:
    names = np.array(rules.classes)
    table = table.select(np.isin(table.label, names))
    order = np.argsort(names)
    return BoxTable(
        sample=table.frame + offset,
        track=table.id,
        label=order[np.searchsorted(names[order], table.label)].astype(np.int8),
        centre_m=table.centre_m,
        score=table.score if isinstance(table, TrackTable) else np.full(len(table), -1.0),
        num_points=table.num_points if isinstance(table, TruthTable) else np.full(len(table), -1),
    )


def _merged(scenes: Sequence[BoxTable]) -> BoxTable:
    """One table of all scenes; an identity in two scenes is two tracks."""
    merged = BoxTable.stacked(*scenes)
    scene = np.repeat(np.arange(len(scenes)), [len(boxes) for boxes in scenes])
    _, track = np.unique(np.column_stack([scene, merged.track]), axis=0, return_inverse=True)
    return BoxTable(
        merged.sample, track, merged.label, merged.centre_m, merged.score, merged.num_points
    )


def _no_racks() -> Racks:
    return Racks(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 4)))

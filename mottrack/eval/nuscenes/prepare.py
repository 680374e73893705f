"""Preparation of the boxes: filter, mean score of a track, gaps filled; from scene results too."""

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import NamedTuple

import numpy as np

from mottrack.core import SceneResult
from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.errors import InputError
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.eval.nuscenes.boxes import BoxTable, GroundTruth, Prepared, Samples
from mottrack.eval.nuscenes.racks import in_rack, racks_in
from mottrack.eval.nuscenes.rules import RANGES_M, Rules
from mottrack.formats.nuscenes_classes import RACKED_CLASSES

FAR_M = 1e4
"""Scenes farther than this from the origin are shifted there. No map of nuScenes reaches as far:
its results are evaluated bit for bit as by the official code."""


def prepare(truth: GroundTruth, predictions: BoxTable, rules: Rules) -> Prepared:
    """Filter the boxes, average the scores of tracks and fill their gaps.

    Raises:
        InputError: the arrays do not fit together, or no true or no predicted box is left to
            evaluate.
    """
    for boxes, name in ((truth.boxes, "truth"), (predictions, "predictions")):
        check_boxes(boxes, len(truth.samples), rules, name)
    prepared = _prepared(truth, predictions, rules)
    sides = ((truth.boxes, prepared.truth), (predictions, prepared.tracks))
    for name, (boxes, left) in zip(("truth", "predictions"), sides, strict=True):
        if not len(left):
            why = f"{len(boxes)} boxes, none in range with points and a class that is evaluated"
            raise InputError(name, why, "at least one box to evaluate")
    return prepared


def _prepared(truth: GroundTruth, predictions: BoxTable, rules: Rules) -> Prepared:
    true_boxes, tracks = (
        kept.select(np.argsort(kept.sample, kind="stable"))
        for boxes in (truth.boxes, predictions)
        for kept in (boxes.select(kept_boxes(boxes, truth, rules)),)
    )
    tracks = tracks.with_score(mean_scores(tracks))
    return Prepared(
        truth.samples,
        fill_gaps(true_boxes, truth.samples, rules),
        fill_gaps(tracks, truth.samples, rules),
    )


def check_boxes(boxes: BoxTable, samples: int, rules: Rules, name: str) -> None:
    """Check the columns of a table.

    Raises:
        InputError: columns differ in length, an index is out of range, or a number not finite.
    """
    for column in fields(boxes):
        length = len(getattr(boxes, column.name))
        if length != len(boxes):
            raise InputError(f"{name}.{column.name}", f"{length} long", f"{len(boxes)} as sample")
    for column_name, limit in (("sample", samples), ("label", len(rules.classes))):
        values = getattr(boxes, column_name)
        if len(boxes) and not (values.min() >= 0 and values.max() < limit):
            found = f"between {values.min()} and {values.max()}"
            raise InputError(f"{name}.{column_name}", found, f"between 0 and {limit - 1}")
    for column_name in ("centre_m", "score"):
        if not np.isfinite(getattr(boxes, column_name)).all():
            raise InputError(f"{name}.{column_name}", "NaN or infinity", "finite numbers")


def kept_boxes(boxes: BoxTable, truth: GroundTruth, rules: Rules) -> Mask:
    """Return the boxes nearer to the ego than their class's range, with points, not in a rack."""
    apart = boxes.centre_m[:, :2] - truth.samples.ego_xy_m[boxes.sample]
    distance = np.sqrt((apart**2).sum(axis=1))
    kept: Mask = distance < np.array(rules.ranges_m)[boxes.label]
    kept &= boxes.num_points != 0
    racked = [i for i, name in enumerate(rules.classes) if name in RACKED_CLASSES]
    suspects = np.flatnonzero(kept & np.isin(boxes.label, racked))
    sample, centre_m = boxes.sample[suspects], boxes.centre_m[suspects]
    kept[suspects[in_rack(sample, centre_m, truth.racks)]] = False
    return kept


def mean_scores(boxes: BoxTable) -> F64:
    """Return the mean score of each box's track (N,), whatever the classes.

    Thresholds are compared with these means, so they equal numpy's mean of a list of the scores in
    order of time to the last bit: tracks of equal length are averaged together, row by row.
    """
    if not len(boxes):
        return boxes.score
    order = np.argsort(boxes.track, kind="stable")
    track = boxes.track[order]
    starts = np.flatnonzero(np.r_[True, track[1:] != track[:-1]])
    lengths = np.diff(np.r_[starts, len(track)])
    score = np.ascontiguousarray(boxes.score[order])
    means = np.empty(len(starts))
    for length in np.unique(lengths):
        which = np.flatnonzero(lengths == length)
        rows = score[starts[which][:, None] + np.arange(length)]
        means[which] = np.mean(rows, axis=1)
    out = np.empty(len(boxes))
    out[order] = np.repeat(means, lengths)
    return out


def fill_gaps(boxes: BoxTable, samples: Samples, rules: Rules) -> BoxTable:
    """Add a box wherever a track misses samples between two of its boxes; sort by sample.

    Class and identity are those of the box after the gap. The weights are a share of time, either
    swapped as in the official code or correct (`Rules.interpolation`). In a sample the added boxes
    follow the given ones, in the order in which their tracks first appear in the scene.
    """
    if not len(boxes):
        return boxes
    order = np.argsort(boxes.track, kind="stable")
    track, sample = boxes.track[order], boxes.sample[order]
    starts = np.flatnonzero(np.r_[True, track[1:] != track[:-1]])
    appeared = np.repeat(order[starts], np.diff(np.r_[starts, len(track)]))
    before = np.flatnonzero((track[1:] == track[:-1]) & (np.diff(sample) > 1))
    missing = sample[before + 1] - sample[before] - 1
    gap = np.repeat(before, missing)
    step = np.arange(len(gap)) - np.repeat(np.cumsum(missing) - missing, missing) + 1
    left, right = boxes.select(order[gap]), boxes.select(order[gap + 1])
    added = _between(left, right, sample[gap] + step, samples, rules)
    rank = np.r_[np.arange(len(boxes)), len(boxes) + appeared[gap]]
    together = BoxTable.stacked(boxes, added)
    return together.select(np.lexsort((rank, together.sample)))


def _between(
    left: BoxTable, right: BoxTable, sample: I64, samples: Samples, rules: Rules
) -> BoxTable:
    stamp = samples.stamp_us
    span = stamp[right.sample] - stamp[left.sample]
    since = stamp[right.sample] - stamp[sample]
    if rules.interpolation == "fixed":
        since = stamp[sample] - stamp[left.sample]
    share = since / span
    centre = (1.0 - share)[:, None] * left.centre_m + share[:, None] * right.centre_m
    score = (1.0 - share) * left.score + share * right.score
    unknown = np.full(len(sample), -1)
    return BoxTable(sample, right.track, right.label, centre, score, unknown)


def prepare_results(results: Sequence[SceneResult], rules: Rules) -> Prepared:
    """Prepare truth and tracks of scenes, from any data set, as the official evaluation does.

    Raises:
        InputError: no true or no tracked box is left to evaluate.
    """
    return prepare(*_as_boxes(results, rules), rules)


def prepare_scenes(results: Sequence[SceneResult], rules: Rules) -> Prepared:
    """Prepare some scenes of many; they may have nothing to evaluate."""
    return _prepared(*_as_boxes(results, rules), rules)


class _Boxes(NamedTuple):
    truth: GroundTruth
    tracks: BoxTable


def _as_boxes(results: Sequence[SceneResult], rules: Rules) -> _Boxes:
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
    racks = racks_in([result.truth for result in results], offsets.tolist())
    return _Boxes(GroundTruth(samples, _merged(truth), racks), _merged(tracks))


def _near_origin(result: SceneResult) -> SceneResult:
    """Shift the scene by whole metres if it lies more than `FAR_M` from the world's origin.

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
    """Return rules with the official ranges where every class has one, else without a limit."""
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
    """Return one table of all scenes; an identity in two scenes is two tracks."""
    merged = BoxTable.stacked(*scenes)
    scene = np.repeat(np.arange(len(scenes)), [len(boxes) for boxes in scenes])
    _, track = np.unique(np.column_stack([scene, merged.track]), axis=0, return_inverse=True)
    return replace(merged, track=track)

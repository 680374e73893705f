"""Truth and tracks of one scene and class, reduced to what the curves need, and their matches."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mottrack.core import SceneResult
from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.sweep import seconds_between
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.eval import clear
from mottrack.eval.evaluation import Evaluation
from mottrack.eval.kitti.boxes import KittiBoxes
from mottrack.eval.nuscenes.boxes import BoxTable, Prepared
from mottrack.eval.nuscenes.metrics import Metrics
from mottrack.eval.pairs import BoxStream, centre_distance, find_pairs
from mottrack.eval.scores import ScoreConfig, scored_part, selected

GATE_M = 2.0
"""Centres nearer than this over the ground match: nuScenes' gate, used for every data set."""


class Side(NamedTuple):
    """N boxes by frame, true or tracked."""

    frame: I64
    """(N,) ascending."""
    id: I64
    """(N,)"""
    xy_m: F64
    """(N, 2) over the ground, in a frame that stands still or moves with the vehicle."""
    velocity_mps: F64
    """(N, 2) NaN where unknown."""
    range_m: F64
    """(N,) from the vehicle."""
    points: I64
    """(N,) LiDAR returns, -1 where unknown."""


@dataclass(frozen=True)
class Tracking:
    """One scene, all classes that are matched with each other."""

    stamp_s: F64
    """(T,) of every frame."""
    truth: Side
    tracks: Side
    tracker_s: F64 = field(default_factory=lambda: np.zeros(0))
    """(T,) seconds that the tracker took; empty where nobody measured."""

    def match(self) -> clear.Association:
        """Return CLEAR's matches of all boxes."""
        pairs = find_pairs(
            BoxStream(self.truth.frame, self.truth.id),
            BoxStream(self.tracks.frame, self.tracks.id),
            len(self.stamp_s),
            centre_distance(self.truth.xy_m, self.tracks.xy_m, GATE_M),
        )
        return clear.associate(pairs.within(GATE_M))


Scene = tuple[Tracking, ...]
"""The classes of a scene that count, each matched alone."""


def of_results(results: Sequence[SceneResult], config: ScoreConfig) -> list[Scene]:
    """Return the scenes of a run, by the classes and least scores that its figures are made with.

    Only frames and places with labels count, and true boxes from their first return on.
    """
    parts = [scored_part(result, config) for result in results]
    filters = Evaluation(results, config).filters
    return [tuple(_of_result(part, *selected(part, f)) for f in filters) for part in parts]


def _of_result(result: SceneResult, truth: TruthTable, tracks: TrackTable) -> Tracking:
    known = ~truth.interpolated[:, None]  # a filled gap tells no velocity
    true = _side(result, truth, np.where(known, truth.velocity_mps, np.nan), truth.num_points)
    unknown = np.full(len(tracks), -1)
    said = _side(result, tracks, tracks.velocity_mps, unknown)
    stamp_ns = result.frames.stamp_ns
    stamp_s = seconds_between(stamp_ns[0], stamp_ns)
    spent_s = result.timings_s.get("tracker", np.zeros(0))
    return Tracking(stamp_s, true, said, spent_s if len(spent_s) == len(stamp_s) else np.zeros(0))


def _side(
    result: SceneResult, table: TruthTable | TrackTable, velocity_mps: F64, points: I64
) -> Side:
    xy_m = table.centre_m[:, :2]
    from_ego_m = xy_m - result.frames.world_T_ego[table.frame, :2, 3]
    return Side(table.frame, table.id, xy_m, velocity_mps, np.hypot(*from_ego_m.T), points)


def of_submission(prepared: Prepared, metrics: Metrics) -> list[Scene]:
    """Return the scenes of a nuScenes submission, tracks of each class at its level of best MOTA.

    A submission's velocities are not read, so there is no curve of their errors.
    """
    scenes: list[Scene] = []
    for first, end in pairwise(prepared.samples.first.tolist()):
        found = []
        for label, name in enumerate(metrics.rules.classes):
            curves = metrics.curves[name]
            known = not np.isnan(curves["mota"]).all()
            best = curves["confidence"][int(np.nanargmax(curves["mota"]))] if known else np.inf
            tracks = prepared.tracks.select(prepared.tracks.score >= best)
            true, said = (
                _of_boxes(boxes, boxes.label == label, prepared, (first, end))
                for boxes in (prepared.truth, tracks)
            )
            stamp_us = prepared.samples.stamp_us[first:end]
            found.append(Tracking((stamp_us - stamp_us[0]) * 1e-6, true, said))
        scenes.append(tuple(found))
    return scenes


def _of_boxes(boxes: BoxTable, kept: Mask, prepared: Prepared, span: tuple[int, int]) -> Side:
    part = boxes.select(kept & (boxes.sample >= span[0]) & (boxes.sample < span[1]))
    xy_m = part.centre_m[:, :2]
    range_m = np.hypot(*(xy_m - prepared.samples.ego_xy_m[part.sample]).T)
    unknown = np.full((len(part), 2), np.nan)
    return Side(part.sample - span[0], part.track, xy_m, unknown, range_m, part.num_points)


KITTI_HZ = 10.0  # rate of the Velodyne HDL-64E in KITTI


def of_kitti(truth: KittiBoxes, tracks: KittiBoxes, kind: str) -> Scene:
    """Return a sequence of KITTI's files, one class; the files have no velocities and no returns.

    Args:
        truth: labels.
        tracks: results; every box counts, whatever its score.
        kind: class in lower case.
    """
    frames = int(max(truth.frame.max(initial=-1), tracks.frame.max(initial=-1))) + 1
    true, said = (_of_sequence(boxes.select(boxes.kind == kind)) for boxes in (truth, tracks))
    return (Tracking(np.arange(frames) / KITTI_HZ, true, said),)


def _of_sequence(boxes: KittiBoxes) -> Side:
    boxes = boxes.select(np.argsort(boxes.frame, kind="stable"))
    xy_m = boxes.box[:, :2]
    unknown, points = np.full((len(boxes), 2), np.nan), np.full(len(boxes), -1)
    return Side(boxes.frame, boxes.id, xy_m, unknown, np.hypot(*xy_m.T), points)


def histories(side: Side) -> Iterator[I64]:
    """Yield the rows of each identity in order of time."""
    order = np.argsort(side.id, kind="stable")
    yield from np.split(order, np.flatnonzero(np.diff(side.id[order])) + 1) if len(order) else ()

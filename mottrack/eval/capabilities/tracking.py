"""Truth and tracks of one scene and class, reduced to what the curves need, and their matches."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mottrack.core import SceneResult
from mottrack.core.arrays import F64, I64
from mottrack.core.sweep import seconds_between
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.eval import clear
from mottrack.eval.pairs import BoxStream, centre_distance, find_pairs
from mottrack.eval.scores import ScoreFilter
from mottrack.eval.tracked_scenes import TrackedScenes

GATE_M = 2.0
"""Centres nearer than this over the ground match: nuScenes' gate, used for every data set."""


class Side(NamedTuple):
    """N boxes by frame: true, tracked, or what the tracker received."""

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
    objects: Side | None = None
    """What the tracker received, each box with an identity of its own; None where not known."""

    def match(self) -> clear.Association:
        """Return CLEAR's matches of all track boxes with true ones."""
        return self._matched(self.tracks)

    @cached_property
    def detected(self) -> clear.Association | None:
        """The same matches of what the tracker received; None where that is not known."""
        return None if self.objects is None else self._matched(self.objects)

    def _matched(self, side: Side) -> clear.Association:
        pairs = find_pairs(
            BoxStream(self.truth.frame, self.truth.id),
            BoxStream(side.frame, side.id),
            len(self.stamp_s),
            centre_distance(self.truth.xy_m, side.xy_m, GATE_M),
        )
        return clear.associate(pairs.within(GATE_M))


Scene = tuple[Tracking, ...]
"""The classes of a scene that count, each matched alone."""


def of_scenes(scenes: TrackedScenes) -> list[Scene]:
    """Return scenes by the classes and least scores that their figures are made with.

    Only frames and places with labels count, and true boxes from their first return on.
    """
    return [
        tuple(_of_class(scenes, index, one) for one in scenes.filters)
        for index in range(len(scenes.results))
    ]


def _of_class(scenes: TrackedScenes, index: int, score_filter: ScoreFilter) -> Tracking:
    result = scenes.part(index)
    truth, tracks = scenes.boxes(index, score_filter)
    seen = ~truth.interpolated[:, None]  # a filled gap tells no velocity
    known = scenes.known_velocity(tracks)[:, None]
    stamp_ns = result.frames.stamp_ns
    stamp_s = seconds_between(stamp_ns[0], stamp_ns)
    spent_s = result.timings_s.get("tracker", np.zeros(0))
    return Tracking(
        stamp_s,
        _side(result, truth, np.where(seen, truth.velocity_mps, np.nan), truth.num_points),
        _side(result, tracks, np.where(known, tracks.velocity_mps, np.nan), _unknown(len(tracks))),
        spent_s if len(spent_s) == len(stamp_s) else np.zeros(0),
        _objects(scenes, index, score_filter),
    )


def _objects(scenes: TrackedScenes, index: int, score_filter: ScoreFilter) -> Side | None:
    """Return what the tracker received of a class within its range."""
    found, result = scenes.objects_of(index), scenes.part(index)
    if found is None:
        return None
    if score_filter.label:
        found = found.select(found.label == score_filter.label)
    xy_m = found.centre_m[:, :2]
    range_m = np.hypot(*(xy_m - result.frames.world_T_ego[found.frame, :2, 3]).T)
    near = range_m < score_filter.range_m
    number = np.arange(len(found))
    side = Side(found.frame, number, xy_m, found.velocity_mps, range_m, _unknown(len(found)))
    return Side(*(column[near] for column in side))


def _unknown(count: int) -> I64:
    return np.full(count, -1)


def _side(
    result: SceneResult, table: TruthTable | TrackTable, velocity_mps: F64, points: I64
) -> Side:
    xy_m = table.centre_m[:, :2]
    from_ego_m = xy_m - result.frames.world_T_ego[table.frame, :2, 3]
    return Side(table.frame, table.id, xy_m, velocity_mps, np.hypot(*from_ego_m.T), points)


def histories(side: Side) -> Iterator[I64]:
    """Yield the rows of each identity in order of time."""
    order = np.argsort(side.id, kind="stable")
    yield from np.split(order, np.flatnonzero(np.diff(side.id[order])) + 1) if len(order) else ()

"""Probable label errors: what detections, flow and tracks agree on and the labels deny."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.result import SceneResult
from mottrack.core.tables import TrackTable, TruthTable
from mottrack.eval.flow_error import GROSS_MPS
from mottrack.eval.label_errors.evidence import Evidence
from mottrack.eval.scores import ScoreFilter
from mottrack.eval.tracked_scenes import TrackedScenes

Kind = Literal["missing label", "other class", "other motion"]
FEWEST_FRAMES = 3
"""Key frames of support: a single false detection makes a track of one or two."""
MOST_APART = 3
"""Key frames between two of them: a weak detection or two in between deny nothing."""
SAME_PLACE_M = 1.0
"""A label of another class is of the same object only where it is as near as a detection must be to
a track."""
MOTION_MPS = 2.0
"""A label whose velocity differs by more from both flow and track contradicts them: twice what
flow and track may differ by."""


@dataclass(frozen=True)
class Suspect:
    """One probable error: some frames of one track."""

    scene: str
    scene_index: int
    kind: Kind
    label: str
    """What the track is; empty where tracks have no class."""
    labelled: str
    """What the label says: nothing, another class, or its speed."""
    track_id: int
    first: int
    """Row of the FrameTable, as `last` and `frame`."""
    last: int
    frames: int
    """How many between them support it."""
    frame: int
    """Where the detection is nearest to the track."""
    xy_m: tuple[float, float]
    """There, world frame."""
    score: float
    """Mean score of the track."""
    speed_mps: float
    """Of the track there; NaN where tracks tell no velocity."""
    agreed: tuple[str, ...]
    """Which of detections, flow and tracks agree in these frames."""


def suspects(scenes: TrackedScenes) -> list[Suspect] | str:
    """Return probable label errors, the best supported first; or why none can be sought.

    Tracks count that the figures of the run count, within the area, frames and ranges that are
    labelled. Where tracks have no class only those that move: what stands still and has no label is
    a tree as a rule.
    """
    found: list[Suspect] = []
    for index in range(len(scenes.results)):
        if scenes.objects_of(index) is None:
            return "what the trackers received is not known: run again, or give --detections"
        found += [s for one in scenes.filters for s in _of_class(scenes, index, one)]
    return sorted(found, key=_strength)


def _strength(one: Suspect) -> tuple[int, int, float, str, int]:
    return -len(one.agreed), -one.frames, -one.score, one.scene, one.track_id


def _of_class(scenes: TrackedScenes, index: int, score_filter: ScoreFilter) -> Iterator[Suspect]:
    result, objects = scenes.part(index), scenes.objects_of(index)
    tracks = _counted(result, score_filter)
    truth = scenes.result(index).truth
    if objects is None or not len(tracks):
        return
    evidence = Evidence.of(tracks, objects, truth)
    seen = _Seen(index, scenes, tracks, truth, evidence)
    supported = tracks.observed & evidence.sure
    if not score_filter.label:
        moves = np.hypot(*tracks.velocity_mps.T) > GROSS_MPS
        supported &= moves & evidence.flow
    yield from seen.runs("missing label", supported & (evidence.label.row < 0))
    if score_filter.label:
        yield from seen.runs("other class", supported & seen.other_class)
    yield from seen.runs("other motion", supported & seen.other_motion)


def _counted(result: SceneResult, score_filter: ScoreFilter) -> TrackTable:
    """Return the track boxes that count, by identity and time."""
    tracks = result.tracks
    if score_filter.label:
        tracks = tracks.select(tracks.label == score_filter.label)
    ego_xy_m = result.frames.world_T_ego[tracks.frame, :2, 3]
    near = np.hypot(*(tracks.centre_m[:, :2] - ego_xy_m).T) < score_filter.range_m
    tracks = tracks.select(near & (_mean_scores(tracks) >= score_filter.threshold))
    return tracks.select(np.lexsort((tracks.frame, tracks.id)))


def _mean_scores(tracks: TrackTable) -> F64:
    _, track = np.unique(tracks.id, return_inverse=True)
    mean = np.bincount(track, tracks.score) / np.maximum(np.bincount(track), 1)
    return np.asarray(mean[track])


@dataclass(frozen=True)
class _Seen:
    """Track boxes of one class in a scene, by identity and time, with their evidence."""

    index: int
    """Of the scene."""
    scenes: TrackedScenes
    tracks: TrackTable
    truth: TruthTable
    evidence: Evidence

    @property
    def labelled(self) -> Mask:
        """(N,) whether there is a label."""
        return self.evidence.label.row >= 0

    @property
    def _label_row(self) -> I64:
        return np.where(self.labelled, self.evidence.label.row, 0)

    @property
    def other_class(self) -> Mask:
        """(N,) whether the label nearest to the track is of another class."""
        if not len(self.truth):
            return np.zeros(len(self.tracks), np.bool_)
        said = self.truth.label[self._label_row]
        other: Mask = said != self.tracks.label
        for label in np.unique(self.tracks.label).tolist():
            other &= ~np.isin(said, self.scenes.alike.get(label, ())) | (self.tracks.label != label)
        other &= self.labelled & (self.evidence.label.distance_m < SAME_PLACE_M)
        return other

    @property
    def other_motion(self) -> Mask:
        """(N,) whether the label moves otherwise than flow and track, which agree."""
        if not len(self.truth):
            return np.zeros(len(self.tracks), np.bool_)
        row = self._label_row
        true_mps = self.truth.velocity_mps[row]
        apart = [np.hypot(*(v - true_mps).T) for v in (self.tracks.velocity_mps, self._flow_mps)]
        differs: Mask = np.minimum(*apart) > MOTION_MPS
        same = self.truth.label[row] == self.tracks.label
        alike = same | (self.tracks.label == "")
        differs &= self.labelled & alike & self.evidence.flow & ~self.truth.interpolated[row]
        return differs

    @property
    def _flow_mps(self) -> F64:
        return self.evidence.flow_mps

    def runs(self, kind: Kind, rows: Mask) -> Iterator[Suspect]:
        """Yield the rows of one track that are not far apart, where there are enough."""
        index = np.flatnonzero(rows)
        track, frame = self.tracks.id[index], self.tracks.frame[index]
        breaks = np.flatnonzero((np.diff(track) != 0) | (np.diff(frame) > MOST_APART)) + 1
        for part in np.split(index, breaks):
            if len(part) >= FEWEST_FRAMES:
                yield self._suspect(kind, part)

    def _suspect(self, kind: Kind, rows: I64) -> Suspect:
        tracks, evidence = self.tracks, self.evidence
        at = int(rows[np.argmin(evidence.detection.distance_m[rows])])
        known = bool(self.scenes.known_velocity(tracks)[at])
        flow = known and bool(evidence.flow[rows].mean() > 0.5)  # in most of the frames
        agreed = ("detections", *(("flow",) if flow else ()), "tracks")
        return Suspect(
            scene=self.scenes.part(self.index).name,
            scene_index=self.index,
            kind=kind,
            label=str(tracks.label[at]),
            labelled=self._said(kind, at),
            track_id=int(tracks.id[at]),
            first=int(tracks.frame[rows[0]]),
            last=int(tracks.frame[rows[-1]]),
            frames=len(rows),
            frame=int(tracks.frame[at]),
            xy_m=(float(tracks.centre_m[at, 0]), float(tracks.centre_m[at, 1])),
            score=float(tracks.score[rows].mean()),
            speed_mps=float(np.hypot(*tracks.velocity_mps[at])) if known else float("nan"),
            agreed=agreed,
        )

    def _said(self, kind: Kind, at: int) -> str:
        if kind == "missing label":
            return ""
        row = int(self.evidence.label.row[at])
        if kind == "other class":
            return str(self.truth.label[row])
        return f"{np.hypot(*self.truth.velocity_mps[row]):.1f} m/s"

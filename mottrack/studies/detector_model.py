"""What a detector finds and invents, counted against the truth of recorded scenes."""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, Mask
from mottrack.eval.occlusion import hidden_shares
from mottrack.formats.text_table import Cell, Column, TextTable
from mottrack.studies.tuning.recorded import RecordedScene
from mottrack.trackers.kalman.clutter import spanned_area_m2
from mottrack.trackers.noise_estimation.samples import match_truth

RANGES_M = (0.0, 20.0, 40.0, np.inf)
"""Edges: within 20 m a LiDAR has hundreds of returns of a car, beyond 40 m ten."""
HIDDEN = (0.0, 0.1, 0.6, 1.01)
"""Edges of the hidden share of a box: seen, partly and mostly hidden."""
LEAST_BOXES = 50
"""Of a class with its own row: a share of fewer is off by more than .07."""
STEPS = 50
"""Of Newton's method for two coefficients, which takes about ten."""
RIDGE = 1e-3
"""Weight on squared coefficients: a class that scores separate would have infinite ones."""
NEAREST_CERTAINTY = 1e-4
"""Scores nearer to 0 and 1 have no finite log-odds."""


class Count(NamedTuple):
    """True boxes, and how many of them were detected."""

    boxes: int = 0
    detected: int = 0

    @property
    def share(self) -> float:
        """The probability of detection; NaN without a box."""
        return self.detected / self.boxes if self.boxes else float("nan")

    @classmethod
    def of(cls, detected: Mask, among: Mask) -> Count:
        """Count some boxes."""
        return cls(int(among.sum()), int((detected & among).sum()))


class ScoreModel(NamedTuple):
    """Probability that a detection is true: 1 / (1 + exp(-(offset + slope x))), x as `evidence`."""

    offset: float
    slope: float

    def probability(self, score: F64) -> F64:
        """Return the probability (N,) of scores."""
        p: F64 = 1.0 / (1.0 + np.exp(-(self.offset + self.slope * evidence(score))))
        return p


@dataclass(frozen=True)
class ClassCounts:
    """A detector on one class."""

    all: Count
    after_detection: Count
    """Of objects that were detected in the frame before."""
    after_miss: Count
    by_range: tuple[Count, ...]
    by_hidden: tuple[Count, ...]
    new_or_false: int
    """Detections that match nothing, or an object for the first time."""
    area_m2: float
    """That the detections of each frame span, summed over frames."""
    scores: F64
    """(N,) of all detections."""
    true: Mask
    """(N,) whether they match."""

    @property
    def clutter_per_m2(self) -> float:
        """Density of new and false detections."""
        return self.new_or_false / self.area_m2 if self.area_m2 else float("nan")


def count(scenes: Iterable[RecordedScene], least: int = LEAST_BOXES) -> dict[str, ClassCounts]:
    """Count the detections of scenes against their truth, for classes with at least so many boxes.

    A true box is detected where `match_truth` finds a detection of its class. Only boxes and
    detections where objects are labelled count.
    """
    collected: defaultdict[str, _Collected] = defaultdict(_Collected)
    area_m2 = 0.0
    for scene in scenes:
        area_m2 += _count_scene(scene, collected)
    classes = {name: one.counts(area_m2) for name, one in sorted(collected.items())}
    return {name: one for name, one in classes.items() if one.all.boxes >= least}


def evidence(score: F64) -> F64:
    """Return the log-odds (N,) of scores that are probabilities, and other scores as they are."""
    if len(score) and (score.min() < 0.0 or score.max() > 1.0):
        return score
    inside = np.clip(score, NEAREST_CERTAINTY, 1.0 - NEAREST_CERTAINTY)
    found: F64 = np.log(inside / (1.0 - inside))
    return found


def fit_scores(counts: ClassCounts) -> ScoreModel:
    """Return the logistic model of maximum likelihood (Platt, 1999)."""
    x = np.column_stack([np.ones(len(counts.scores)), evidence(counts.scores)])
    y = counts.true.astype(np.float64)
    w = np.zeros(2)
    for _ in range(STEPS):
        p = 1.0 / (1.0 + np.exp(-x @ w))
        gradient = x.T @ (y - p) - RIDGE * w
        curvature = (x.T * (p * (1.0 - p))) @ x + RIDGE * np.eye(2)
        w = w + np.linalg.solve(curvature, gradient)
    return ScoreModel(float(w[0]), float(w[1]))


@dataclass
class _Collected:
    """Columns of one class, frame by frame."""

    detected: list[Mask] = field(default_factory=list)
    before: list[F64] = field(default_factory=list)
    range_m: list[F64] = field(default_factory=list)
    hidden: list[F64] = field(default_factory=list)
    scores: list[F64] = field(default_factory=list)
    true: list[Mask] = field(default_factory=list)
    first: int = 0

    def counts(self, area_m2: float) -> ClassCounts:
        """Return the counts."""
        detected = _joined(self.detected, np.bool_)
        before, range_m, hidden = (
            _joined(c, np.float64) for c in (self.before, self.range_m, self.hidden)
        )
        true = _joined(self.true, np.bool_)
        return ClassCounts(
            all=Count.of(detected, np.ones(len(detected), np.bool_)),
            after_detection=Count.of(detected, before == 1.0),
            after_miss=Count.of(detected, before == 0.0),
            by_range=_binned(detected, range_m, RANGES_M),
            by_hidden=_binned(detected, hidden, HIDDEN),
            new_or_false=int((~true).sum()) + self.first,
            area_m2=area_m2,
            scores=_joined(self.scores, np.float64),
            true=true,
        )


def _joined(parts: Sequence[np.ndarray], kind: type) -> np.ndarray:
    return np.concatenate([np.empty(0, kind), *parts])


def _binned(detected: Mask, value: F64, edges: Sequence[float]) -> tuple[Count, ...]:
    pairs = itertools.pairwise(edges)
    return tuple(Count.of(detected, (value >= low) & (value < high)) for low, high in pairs)


def _count_scene(scene: RecordedScene, collected: dict[str, _Collected]) -> float:
    """Add a scene; return the area that its detections span."""
    frames, hidden = scene.result.frames, hidden_shares(scene.result)
    last: dict[int, bool] = {}
    known: set[int] = set()
    area_m2 = 0.0
    rows = np.flatnonzero(frames.annotated)
    for k, (objects, truth) in zip(rows.tolist(), scene.truth_frames(), strict=True):
        place = [frames.labelled(np.full(len(b), k), b.centre_m) for b in (objects, truth)]
        i, j = match_truth(objects, truth)
        true, detected = np.isin(np.arange(len(objects)), i), np.isin(np.arange(len(truth)), j)
        share = np.array([hidden[k, one] for one in truth.id.tolist()])
        before = np.array([float(last.get(one, np.nan)) for one in truth.id.tolist()])
        range_m = np.hypot(*(truth.centre_m[:, :2] - frames.world_T_ego[k, :2, 3]).T)
        first = np.array([one not in known for one in truth.id.tolist()], np.bool_)
        for name in np.unique(np.concatenate([objects.label, truth.label])).tolist():
            own = collected[name]
            at, mine = place[1] & (truth.label == name), place[0] & (objects.label == name)
            own.detected.append(detected[at])
            own.before.append(before[at])
            own.range_m.append(range_m[at])
            own.hidden.append(share[at])
            own.scores.append(objects.score[mine])
            own.true.append(true[mine])
            own.first += int((detected & first & at).sum())
        last = dict(zip(truth.id.tolist(), detected.tolist(), strict=True))
        known |= set(truth.id[detected].tolist())
        area_m2 += spanned_area_m2(objects.centre_m[:, :2])
    return area_m2


def counts_table(found: Mapping[str, ClassCounts]) -> TextTable:
    """Tabulate boxes, clutter, and the scores of which half and nine in ten are true."""
    rows: list[tuple[Cell, ...]] = []
    for label, one in found.items():
        if len(one.scores):
            model = fit_scores(one)
            true = int(one.true.sum())
            numbers = (model.offset, model.slope)
            rows.append(
                (label, one.all.boxes, len(one.scores), true, *numbers, 1e3 * one.clutter_per_m2)
            )
    columns = (
        *(Column(name) for name in ("class", "true boxes", "detections", "of these true")),
        *(Column(name) for name in ("offset", "slope")),
        Column("clutter per 1000 m2", 2),
    )
    note = (
        "A detection of score s is true with the probability 1 / (1 + exp(-(offset + slope x))), x "
        "the log-odds of s, or s itself where it is no probability. Clutter: detections that match "
        "no true box, or one for the first time, over the area that each frame's detections span."
    )
    return TextTable("detections", "Detections, counted", columns, tuple(rows), note)


def rate_table(found: Mapping[str, ClassCounts]) -> TextTable:
    """Tabulate the counted probability of detection by what came before, range and occlusion."""
    rows: list[tuple[Cell, ...]] = [
        (label, *_rates(one)) for label, one in found.items() if len(one.scores)
    ]
    before = ("all", "detected before", "missed before")
    ranges = (f"from {low:.0f} m" for low in RANGES_M[:-1])
    hidden = (f"hidden from {low:.1f}" for low in HIDDEN[:-1])
    columns = (Column("class"), *map(Column, (*before, *ranges, *hidden)))
    note = "Hidden: the share of the box's directions in which a nearer true box stands."
    return TextTable(
        "detection_rates", "Probability of detection, counted", columns, tuple(rows), note
    )


def _rates(counts: ClassCounts) -> list[float]:
    before = (counts.all, counts.after_detection, counts.after_miss)
    return [one.share for one in (*before, *counts.by_range, *counts.by_hidden)]

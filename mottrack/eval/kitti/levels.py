"""Figures at forty recall levels, their averages, and the level of best MOTA."""

from collections.abc import Sequence as Listed
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mottrack.core.arrays import F64
from mottrack.core.errors import InputError
from mottrack.eval.kitti.counts import KittiCounts, count, total
from mottrack.eval.kitti.matching import Sequence, match, mean_over_tracks
from mottrack.eval.kitti.rules import KittiRules


@dataclass(frozen=True, slots=True)
class Level:
    """The figures at one score threshold."""

    threshold: float
    recall_level: float
    """The recall that the threshold was chosen for."""
    counts: KittiCounts

    @property
    def mota(self) -> float:
        """1 - (fn + fp + ids) / truth, not clipped."""
        c = self.counts
        return 1.0 - (c.fn + c.fp + c.ids) / c.truth

    @property
    def smota(self) -> float:
        """MOTA scaled by the recall asked for, in [0, 1]."""
        c, r = self.counts, self.recall_level
        errors = c.fn + c.fp + c.ids - (1.0 - r) * c.truth
        return min(1.0, max(0.0, 1.0 - errors / (r * c.truth)))

    @property
    def motp(self) -> float:
        """Mean overlap of the matches; 0 without one."""
        return self.counts.iou / self.counts.tp if self.counts.tp else 0.0

    def as_dict(self) -> dict[str, float]:
        """All figures of the level; MT and ML are shares of the true tracks."""
        c = self.counts
        tracks = c.trajectories or 1
        return {
            "threshold": self.threshold,
            "recall_level": self.recall_level,
            "smota": self.smota,
            "mota": self.mota,
            "motp": self.motp,
            **{k: v for k, v in asdict(c).items() if k not in ("mt", "ml", "iou")},
            "mt": c.mt / tracks,
            "ml": c.ml / tracks,
            "recall": c.tp / (c.tp + c.fn) if c.tp + c.fn else 0.0,
            "precision": c.tp / (c.tp + c.fp) if c.tp + c.fp else 0.0,
        }


@dataclass(frozen=True, slots=True)
class KittiMetrics:
    """The result of the protocol for one class."""

    rules: KittiRules
    samota: float
    amota: float
    amotp: float
    best: Level
    levels: tuple[Level, ...]

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers: averages, the best level's figures, and every level."""
        return {
            "class": self.rules.kind,
            "measure": self.rules.measure,
            "min_iou": self.rules.min_iou,
            "samota": self.samota,
            "amota": self.amota,
            "amotp": self.amotp,
            **self.best.as_dict(),
            "levels": [level.as_dict() for level in self.levels],
        }


class _Passes:
    """Passes over all sequences, one after the other.

    The official code replaces the scores of a track by their mean in every pass, so each pass takes
    the mean of the means before it. The last bits that this moves decide whether a track whose mean
    is the threshold takes part; so the passes are kept in the official order, the last one being a
    second look at the best threshold.
    """

    def __init__(self, sequences: Listed[Sequence], rules: KittiRules) -> None:
        self.sequences, self.rules = sequences, rules
        self.scores = [sequence.tracks.score for sequence in sequences]

    def run(self, threshold: float, recall: float) -> tuple[Level, F64]:
        """The counts at a threshold, and the scores of the matched boxes."""
        self.scores = [
            mean_over_tracks(sequence, score)
            for sequence, score in zip(self.sequences, self.scores, strict=True)
        ]
        matches = [
            match(sequence, score >= threshold, self.rules.min_iou)
            for sequence, score in zip(self.sequences, self.scores, strict=True)
        ]
        counts = [count(s, m) for s, m in zip(self.sequences, matches, strict=True)]
        rows = [m.track_row[m.track_row >= 0] for m in matches]
        scores = [score[r] for score, r in zip(self.scores, rows, strict=True)]
        return Level(threshold, recall, total(counts)), np.concatenate([*scores, np.zeros(0)])


def evaluate(sequences: Listed[Sequence], rules: KittiRules) -> KittiMetrics:
    """The metrics of prepared sequences.

    A level that is not reached counts 0 in the averages. Without any level, the pass with all
    tracks stands in for the best.

    Raises InputError where no sequence has a true box of the class that counts.
    """
    passes = _Passes(sequences, rules)
    everything, scores = passes.run(-np.inf, 1.0)
    if not everything.counts.truth:
        raise InputError("labels", f"without a {rules.kind} that counts", "at least one")
    grid = thresholds(scores, everything.counts.tp + everything.counts.fn, rules.levels)
    levels = tuple(passes.run(*point)[0] for point in grid)
    best = max(levels, key=lambda level: level.mota, default=everything)
    return KittiMetrics(
        rules,
        samota=sum(level.smota for level in levels) / rules.levels,
        amota=sum(level.mota for level in levels) / rules.levels,
        amotp=sum(level.motp for level in levels) / rules.levels,
        best=passes.run(best.threshold, best.recall_level)[0],
        levels=levels,
    )


def thresholds(scores: F64, boxes: int, levels: int) -> list[tuple[float, float]]:
    """(threshold, recall) of each level that is reached, the lowest recall first.

    Walking down the scores, each level takes the score whose recall is nearest to it; the level of
    recall 0 is left out.
    """
    points: list[tuple[float, float]] = []
    target = 0.0
    descending = np.sort(scores)[::-1]
    for i, score in enumerate(descending):
        here = (i + 1) / boxes
        last = i == len(descending) - 1
        after = here if last else (i + 2) / boxes
        if not last and after - target < target - here:
            continue
        points.append((float(score), target))
        target += 1.0 / levels
    return points[1:]

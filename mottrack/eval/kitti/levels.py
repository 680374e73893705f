"""Counts of passes, metrics at forty recall levels, their averages, and the level of best MOTA."""

from collections.abc import Iterable
from collections.abc import Sequence as Listed
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.errors import InputError
from mottrack.eval import arithmetic
from mottrack.eval.arithmetic import MOSTLY_LOST, MOSTLY_TRACKED
from mottrack.eval.kitti.matching import KittiRules, Match, Sequence, match, mean_over_tracks


@dataclass(frozen=True, slots=True)
class KittiCounts:
    """Counts that add up over sequences."""

    truth: int = 0
    """True boxes that are not ignored."""
    tp: int = 0
    """Matches, those of ignored boxes included."""
    fp: int = 0
    fn: int = 0
    ids: int = 0
    frag: int = 0
    mt: int = 0
    ml: int = 0
    trajectories: int = 0
    """True tracks that are not ignored in every frame."""
    iou: float = 0.0
    """Sum of the overlap of all matches."""

    @property
    def errors(self) -> int:
        """Misses, false positives and switches."""
        return self.fn + self.fp + self.ids


def count(sequence: Sequence, match: Match) -> KittiCounts:
    """Return the counts of one pass over one sequence."""
    hit = match.track_row >= 0
    ignored = sequence.ignored_truth
    tp = int(np.count_nonzero(hit))
    unmatched = match.active.copy()
    unmatched[match.track_row[hit]] = False
    histories = [_history(ids, ign) for ids, ign in _trajectories(sequence, match) if not ign.all()]
    return KittiCounts(
        truth=int(np.count_nonzero(~ignored)),
        tp=tp,
        fp=int(np.count_nonzero(unmatched & ~sequence.ignored_tracks)),
        fn=int(np.count_nonzero(~hit & ~ignored)),
        ids=sum(h.ids for h in histories),
        frag=sum(h.frag for h in histories),
        mt=sum(bool(h.share > MOSTLY_TRACKED) for h in histories),
        ml=sum(bool(h.share < MOSTLY_LOST) for h in histories),
        trajectories=len(histories),
        iou=float(match.iou.sum()),
    )


@dataclass(frozen=True, slots=True)
class _History:
    """Switches, fragmentations and the share of its frames in which a true track is matched."""

    ids: int
    frag: int
    share: float


def _trajectories(sequence: Sequence, match: Match) -> Iterable[tuple[I64, Mask]]:
    """Yield per true track the matched identity (-1: none) of its frames and whether ignored."""
    identity = np.full(len(sequence.truth), -1)
    hit = match.track_row >= 0
    identity[hit] = sequence.tracks.id[match.track_row[hit]]
    for track in np.unique(sequence.truth.id):
        rows = sequence.truth.id == track
        yield identity[rows], sequence.ignored_truth[rows]


def _history(ids: I64, ignored: Mask) -> _History:
    """Count switches and fragmentations of a true track by KITTI's rule.

    A change of identity is a switch if the box before was matched too. A change, from unmatched
    included, is a fragmentation if the next box is matched as well, or there is none. The first
    match is neither, and an ignored box makes the one after it a first one.
    """
    if (ids < 0).all():
        return _History(0, 0, 0.0)
    last = int(ids[0])
    tracked, switches, fragments = int(ids[0] >= 0), 0, 0
    for f in range(1, len(ids)):
        if ignored[f]:
            last = -1
            continue
        now, before = int(ids[f]), int(ids[f - 1])
        if now >= 0 and last >= 0:
            switches += last != now and before >= 0
            fragments += bool(before != now and (f == len(ids) - 1 or ids[f + 1] >= 0))
        if now >= 0:
            tracked += 1
            last = now
    return _History(switches, fragments, tracked / float(np.count_nonzero(~ignored)))


@dataclass(frozen=True, slots=True)
class Level:
    """The metrics at one score threshold."""

    threshold: float
    recall_level: float
    """The recall that the threshold was chosen for."""
    counts: KittiCounts

    @property
    def mota(self) -> float:
        """1 - (fn + fp + ids) / truth, not clipped."""
        return arithmetic.mota(self.counts.errors, self.counts.truth)

    @property
    def smota(self) -> float:
        """MOTA scaled by the recall asked for, in [0, 1]."""
        c, r = self.counts, self.recall_level
        errors = c.errors - (1.0 - r) * c.truth
        return min(1.0, max(0.0, 1.0 - errors / (r * c.truth)))

    @property
    def motp(self) -> float:
        """Mean overlap of the matches; 0 without one."""
        return self.counts.iou / self.counts.tp if self.counts.tp else 0.0

    def as_dict(self) -> dict[str, float]:
        """Return all metrics of the level; MT and ML are shares of the true tracks."""
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
        """Return plain numbers: averages, the best level's metrics, and every level."""
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
    is the threshold takes part; so the passes keep the official order, of which the last one
    repeats the best threshold.
    """

    def __init__(self, sequences: Listed[Sequence], rules: KittiRules) -> None:
        self.sequences, self.rules = sequences, rules
        self.scores = [sequence.tracks.score for sequence in sequences]

    def run(self, threshold: float, recall: float) -> tuple[Level, F64]:
        """Return the counts at a threshold, and the scores of the matched boxes."""
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
        return Level(threshold, recall, arithmetic.total(counts, KittiCounts())), np.concatenate(
            [*scores, np.zeros(0)]
        )


def evaluate(sequences: Listed[Sequence], rules: KittiRules) -> KittiMetrics:
    """Return the metrics of prepared sequences.

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


def thresholds(scores: F64, boxes: float, levels: int) -> list[tuple[float, float]]:
    """Return (threshold, recall) of each level that is reached, the lowest recall first.

    In descending order of the scores, each level takes the score whose recall is nearest to it; the
    level of recall 0 is left out.
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

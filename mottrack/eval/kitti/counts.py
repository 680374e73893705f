"""Counts of passes: boxes, and the history of each true track."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import I64, Mask
from mottrack.eval.kitti.matching import Match, Sequence

MOSTLY_TRACKED, MOSTLY_LOST = 0.8, 0.2


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


def count(sequence: Sequence, match: Match) -> KittiCounts:
    """The counts of one pass over one sequence."""
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
    ids: int
    frag: int
    share: float


def _trajectories(sequence: Sequence, match: Match) -> Iterable[tuple[I64, Mask]]:
    """Per true track, in its frames, the matched identity (-1: none) and whether it is ignored."""
    identity = np.full(len(sequence.truth), -1)
    hit = match.track_row >= 0
    identity[hit] = sequence.tracks.id[match.track_row[hit]]
    for track in np.unique(sequence.truth.id):
        rows = sequence.truth.id == track
        yield identity[rows], sequence.ignored_truth[rows]


def _history(ids: I64, ignored: Mask) -> _History:
    """Switches and fragmentations of a true track by KITTI's rule.

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


def total(counts: Iterable[KittiCounts]) -> KittiCounts:
    """The counts of several sequences together."""
    listed = list(counts)
    names = KittiCounts.__dataclass_fields__
    return KittiCounts(**{name: sum(getattr(c, name) for c in listed) for name in names})

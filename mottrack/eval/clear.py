"""CLEAR MOT: matches, misses, false positives, switches (Bernardin and Stiefelhagen, 2008).

The variant of py-motmetrics and nuScenes: a pair once matched stays matched while it is near
enough, after a gap of any length; the rest is matched with as many pairs as possible and then the
least total distance.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from mottrack.core.arrays import F64, I64, Mask
from mottrack.eval.pairs import Pairs

MOSTLY_TRACKED, MOSTLY_LOST = 0.8, 0.2


@dataclass(frozen=True, slots=True)
class Association:
    """What each true box of a sequence was matched with."""

    track_row: I64
    """(G,) row of the matched track box, -1 for a miss."""
    switched: Mask
    """(G,) whether the match is with another identity than the object's last one."""
    distance: F64
    """(G,) distance of the match, NaN for a miss."""


@dataclass(frozen=True, slots=True)
class ClearCounts:
    """Counts that add up over sequences."""

    truth: int = 0
    matches: int = 0
    switches: int = 0
    misses: int = 0
    false_positives: int = 0
    fragmentations: int = 0
    mostly_tracked: int = 0
    mostly_lost: int = 0
    truth_tracks: int = 0
    distance: float = 0.0
    """Sum of the distances of all matches, switches included."""

    @property
    def mota(self) -> float:
        """1 - (misses + false positives + switches) / truth; NaN without truth."""
        errors = self.misses + self.false_positives + self.switches
        return 1.0 - errors / self.truth if self.truth else float("nan")

    @property
    def motp(self) -> float:
        """Mean distance of the matches (metres, or 1 - IoU); NaN without a match."""
        hits = self.matches + self.switches
        return self.distance / hits if hits else float("nan")

    @property
    def recall(self) -> float:
        """Share of the true boxes that were matched; NaN without truth."""
        return (self.matches + self.switches) / self.truth if self.truth else float("nan")

    @property
    def precision(self) -> float:
        """Share of the track boxes that were matched; NaN without tracks."""
        hits = self.matches + self.switches
        return hits / (hits + self.false_positives) if hits + self.false_positives else float("nan")


def associate(pairs: Pairs) -> Association:
    """Matches a sequence frame by frame. All listed pairs may be matched: gate them before."""
    count = len(pairs.truth)
    out = Association(np.full(count, -1), np.zeros(count, np.bool_), np.full(count, np.nan))
    truth_id, track_id = pairs.truth.dense_ids(), pairs.tracks.dense_ids()
    last = np.full(int(truth_id.max(initial=-1)) + 1, -1)
    for rows, columns, span in pairs.by_frame():
        if span.start == span.stop:
            continue
        distance = np.full((rows.stop - rows.start, columns.stop - columns.start), np.nan)
        i, j = pairs.truth_row[span] - rows.start, pairs.track_row[span] - columns.start
        distance[i, j] = pairs.distance[span]
        objects, hypotheses = truth_id[rows], track_id[columns]
        match = _match_frame(distance, last[objects], hypotheses)
        hit = np.flatnonzero(match >= 0)
        now = hypotheses[match[hit]]
        out.switched[rows.start + hit] = (last[objects[hit]] >= 0) & (last[objects[hit]] != now)
        out.track_row[rows.start + hit] = columns.start + match[hit]
        out.distance[rows.start + hit] = distance[hit, match[hit]]
        last[objects[hit]] = now
    return out


def _match_frame(distance: F64, last: I64, hypotheses: I64) -> I64:
    """(G,) column of each object of a frame, -1 for none. `distance` is NaN for no pair."""
    match = np.full(len(distance), -1)
    kept, column = np.nonzero((last[:, None] == hypotheses[None, :]) & ~np.isnan(distance))
    for row, col in zip(kept, column, strict=True):
        if match[row] < 0 and col not in match:
            match[row] = col
    free_rows = np.flatnonzero(match < 0)
    free_columns = np.setdiff1d(np.arange(distance.shape[1]), match)
    rest = distance[np.ix_(free_rows, free_columns)]
    if rest.size and not np.isnan(rest).all():
        forbidden = 2.0 * min(rest.shape) * (np.nanmax(rest) + 1.0) + 1.0
        i, j = linear_sum_assignment(np.where(np.isnan(rest), forbidden, rest))
        allowed = ~np.isnan(rest[i, j])
        match[free_rows[i[allowed]]] = free_columns[j[allowed]]
    return match


def clear_counts(pairs: Pairs, association: Association) -> ClearCounts:
    """The counts of one sequence."""
    hit = association.track_row >= 0
    switches = int(np.count_nonzero(association.switched))
    hits = int(np.count_nonzero(hit))
    object_of = pairs.truth.dense_ids()
    length = np.bincount(object_of)
    share = np.bincount(object_of[hit], minlength=len(length)) / np.maximum(length, 1)
    return ClearCounts(
        truth=len(hit),
        matches=hits - switches,
        switches=switches,
        misses=len(hit) - hits,
        false_positives=len(pairs.tracks) - hits,
        fragmentations=_fragmentations(object_of, hit),
        mostly_tracked=int(np.count_nonzero(share >= MOSTLY_TRACKED)),
        mostly_lost=int(np.count_nonzero(share < MOSTLY_LOST)),
        truth_tracks=len(length),
        distance=float(np.nansum(association.distance)),
    )


def _fragmentations(object_of: I64, hit: Mask) -> int:
    """Times that an object is lost and found again: changes from a miss to a hit, but the first."""
    order = np.argsort(object_of, kind="stable")
    objects, found = object_of[order], hit[order]
    starts = found & ~np.r_[False, found[:-1] & (objects[1:] == objects[:-1])]
    return int(np.count_nonzero(starts) - len(np.unique(objects[found])))


def total(counts: Iterable[ClearCounts]) -> ClearCounts:
    """The counts of several sequences or classes together."""
    listed = list(counts)
    names = ClearCounts.__dataclass_fields__
    return ClearCounts(**{name: sum(getattr(c, name) for c in listed) for name in names})

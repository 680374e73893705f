"""CLEAR MOT: matches, misses, false positives, switches (Bernardin and Stiefelhagen, 2008).

The variant of py-motmetrics and nuScenes: a pair once matched stays matched while it is near
enough, after a gap of any length; the rest is matched with as many pairs as possible and then the
least total distance.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, I64, Mask, Texts
from mottrack.eval import arithmetic
from mottrack.eval.arithmetic import MOSTLY_LOST, MOSTLY_TRACKED, distinct
from mottrack.eval.assignment import DENSE, groups, linear_sum_assignment, lone_pairs
from mottrack.eval.pairs import FrameRows, Pairs

MISSES = ("late start", "gap", "early end", "never found")
"""Kinds of miss, see `miss_kinds`."""


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
    """Without switches."""
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
    def errors(self) -> int:
        """Misses, false positives and switches."""
        return self.misses + self.false_positives + self.switches

    @property
    def hits(self) -> int:
        """True boxes that were matched, switches included."""
        return self.matches + self.switches

    @property
    def mota(self) -> float:
        """1 - errors / truth; NaN without truth."""
        return arithmetic.mota(self.errors, self.truth)

    @property
    def motp(self) -> float:
        """Mean distance of the matches (metres, or 1 - IoU); NaN without a match."""
        return arithmetic.ratio(self.distance, self.hits)

    @property
    def recall(self) -> float:
        """Share of the true boxes that were matched; NaN without truth."""
        return arithmetic.ratio(self.hits, self.truth)

    @property
    def precision(self) -> float:
        """Share of the track boxes that were matched; NaN without tracks."""
        return arithmetic.ratio(self.hits, self.hits + self.false_positives)


def associate(pairs: Pairs) -> Association:
    """Match a sequence frame by frame. All listed pairs may be matched: gate them before."""
    count = len(pairs.truth)
    track_row, distance = np.full(count, -1), np.full(count, np.nan)
    truth_id, track_id = pairs.truth.dense_ids(), pairs.tracks.dense_ids()
    last = np.full(int(truth_id.max(initial=-1)) + 1, -1)
    plain = pairs.plain_frames()
    objects, hypotheses = truth_id[pairs.truth_row], track_id[pairs.track_row]
    settled = _settled(pairs, plain)
    track_row[pairs.truth_row[settled]] = pairs.track_row[settled]
    distance[pairs.truth_row[settled]] = pairs.distance[settled]
    done = 0
    crowded = np.flatnonzero(~plain)
    for rows in pairs.by_frame(crowded):
        # what is settled up to here, in order of time: of an object's matches the last one stays
        before = slice(done, rows.pairs.stop)
        certain = settled[before]
        last[objects[before][certain]] = hypotheses[before][certain]
        done = rows.pairs.stop
        for part in _parts(pairs, rows):
            i, j = truth_id[rows.truth][part.row], track_id[rows.tracks][part.column]
            match = _match_frame(part.distance, last[i], j)
            hit = np.flatnonzero(match >= 0)
            row = rows.truth.start + part.row[hit]
            track_row[row] = rows.tracks.start + part.column[match[hit]]
            distance[row] = part.distance[hit, match[hit]]
            last[i[hit]] = j[match[hit]]
    return Association(track_row, _switches(truth_id, track_id, track_row), distance)


def _switches(truth_id: I64, track_id: I64, track_row: I64) -> Mask:
    """Return whether each true box is matched with another identity than its object's last one."""
    hit = np.flatnonzero(track_row >= 0)
    hit = hit[np.argsort(truth_id[hit], kind="stable")]
    now = track_id[track_row[hit]]
    switched = np.zeros(len(truth_id), np.bool_)
    switched[hit[1:]] = (truth_id[hit[1:]] == truth_id[hit[:-1]]) & (now[1:] != now[:-1])
    return switched


class _Part(NamedTuple):
    """Boxes of a frame that are matched independently of the others."""

    row: I64
    """(g,) among the true boxes of the frame."""
    column: I64
    """(p,) among its track boxes."""
    distance: F64
    """(g, p) NaN where a pair must not be matched."""


def _parts(pairs: Pairs, rows: FrameRows) -> Iterator[_Part]:
    """Yield the whole frame; of a crowd the boxes that share pairs."""
    i = np.arange(rows.truth.stop - rows.truth.start)
    j = np.arange(rows.tracks.stop - rows.tracks.start)
    if len(i) * len(j) <= DENSE:
        yield _Part(i, j, pairs.matrix(rows, pairs.distance, np.nan))
        return
    row = pairs.truth_row[rows.pairs] - rows.truth.start
    column = pairs.track_row[rows.pairs] - rows.tracks.start
    shared = ~lone_pairs(row, column)
    for group in groups(row[shared], column[shared]):
        yield _Part(*group.matrix(pairs.distance[rows.pairs][shared], np.nan))


def _settled(pairs: Pairs, plain: Mask) -> Mask:
    """Return the pairs that are matched for certain, (P,).

    Those of frames in which no box has two pairs, and of a crowd those that share no box.
    """
    sizes = np.diff(pairs.truth.edges(pairs.frames)) * np.diff(pairs.tracks.edges(pairs.frames))
    lone = lone_pairs(pairs.truth_row, pairs.track_row)
    return plain[pairs.frame] | (lone & (sizes > DENSE)[pairs.frame])


def _match_frame(distance: F64, last: I64, hypotheses: I64) -> I64:
    """Return the column of each object of a frame (G,), -1 for none.

    Args:
        distance: (G, P) NaN where a pair must not be matched.
        last: (G,) identity of each object's last match, -1 for none.
        hypotheses: (P,) identity of each track box.
    """
    match = np.full(len(distance), -1)
    kept, column = np.nonzero((last[:, None] == hypotheses[None, :]) & ~np.isnan(distance))
    for row, col in zip(kept, column, strict=True):
        if match[row] < 0 and col not in match:
            match[row] = col
    free_rows = np.flatnonzero(match < 0)
    free = np.ones(distance.shape[1], np.bool_)
    free[match[match >= 0]] = False
    free_columns = np.flatnonzero(free)
    rest = distance[free_rows[:, None], free_columns]
    barred = np.isnan(rest)
    if not barred.all():
        # more than all allowed pairs together, so that no match is given up for a lesser distance
        forbidden = 2.0 * min(rest.shape) * (np.nanmax(rest) + 1.0) + 1.0
        i, j = linear_sum_assignment(np.where(barred, forbidden, rest))
        allowed = ~barred[i, j]
        match[free_rows[i[allowed]]] = free_columns[j[allowed]]
    return match


def clear_counts(pairs: Pairs, association: Association) -> ClearCounts:
    """Return the counts of one sequence."""
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
    """Count changes from a miss to a hit, but for the first hit of each object."""
    order = np.argsort(object_of, kind="stable")
    objects, found = object_of[order], hit[order]
    starts = found & ~np.r_[False, found[:-1] & (objects[1:] == objects[:-1])]
    return int(np.count_nonzero(starts) - len(distinct(objects[found])))


def miss_kinds(object_of: I64, frame: I64, hit: Mask) -> Texts:
    """Return the kind of miss that each true box is, should it be one, (G,).

    A "late start" lies before the first hit of its object, an "early end" after the last, a "gap"
    between hits; a box of an object without a hit is "never found".

    Args:
        object_of: (G,) number of each box's object, from 0.
        frame: (G,) frame of each box.
        hit: (G,) whether the box was matched.
    """
    first, last = hit_span(object_of, frame, hit)
    conditions = [last < 0, frame < first, frame > last]
    return np.select(conditions, ["never found", "late start", "early end"], "gap")


def hit_span(object_of: I64, frame: I64, hit: Mask) -> tuple[I64, I64]:
    """Return the first and the last frame in which each box's object is hit, (G,) each.

    An object without a hit has the last frame -1.
    """
    count = int(object_of.max(initial=-1)) + 1
    first, last = np.full(count, np.iinfo(np.int64).max), np.full(count, -1)
    np.minimum.at(first, object_of[hit], frame[hit])
    np.maximum.at(last, object_of[hit], frame[hit])
    return first[object_of], last[object_of]


def total(counts: Iterable[ClearCounts]) -> ClearCounts:
    """Return the counts of several sequences or classes together."""
    return arithmetic.total(counts, ClearCounts())

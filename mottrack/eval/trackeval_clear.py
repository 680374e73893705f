"""CLEAR MOT as TrackEval computes it, which Argoverse 2 and KITTI's HOTA tables use.

It differs from `mottrack.eval.clear` (the variant of py-motmetrics and nuScenes) in three rules: a
pair stays matched from the frame before alone, a frame with boxes of one side only not counted; of
the others the greatest total similarity is matched, not the most pairs; and an object is mostly
tracked above 80 % of its frames, not from 80 %.
"""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.eval.arithmetic import MOSTLY_LOST, MOSTLY_TRACKED
from mottrack.eval.assignment import linear_sum_assignment
from mottrack.eval.clear import ClearCounts
from mottrack.eval.pairs import FrameRows, Pairs

CONTINUES = 1000.0
"""What a pair that was matched in the frame before is worth beside a similarity of at most 1."""
ROUNDING = float(np.finfo(np.float64).eps)
"""As TrackEval: a similarity of the threshold itself still matches."""


def trackeval_counts(pairs: Pairs, min_similarity: float = 0.5) -> ClearCounts:
    """Return the counts of one sequence.

    Args:
        pairs: all pairs of positive similarity.
        min_similarity: of a match.

    Returns:
        The counts; the sum of distances is that of 1 - similarity.
    """
    near = pairs.similar(min_similarity - ROUNDING)
    match = _match(near)
    hit = match >= 0
    truth_id, track_id = near.truth.dense_ids(), near.tracks.dense_ids()
    objects, identity = truth_id[hit], track_id[match[hit]]
    length = np.bincount(truth_id)
    share = np.bincount(objects, minlength=len(length)) / np.maximum(length, 1)
    switches = _changes(objects, identity)
    hits = int(np.count_nonzero(hit))
    return ClearCounts(
        truth=len(hit),
        matches=hits - switches,
        switches=switches,
        misses=len(hit) - hits,
        false_positives=len(near.tracks) - hits,
        fragmentations=_fragments(near, hit, truth_id),
        mostly_tracked=int(np.count_nonzero(share > MOSTLY_TRACKED)),
        mostly_lost=int(np.count_nonzero(share < MOSTLY_LOST)),
        truth_tracks=len(length),
        distance=float((1.0 - _similarity(near, match, hit)).sum()),
    )


def _similarity(pairs: Pairs, match: I64, hit: Mask) -> F64:
    """Return the similarity of each match, (hits,)."""
    chosen = match[pairs.truth_row] == pairs.track_row
    similarity: F64 = pairs.similarity[chosen & hit[pairs.truth_row]]
    return similarity


def _changes(objects: I64, identity: I64) -> int:
    """Count the matches, in order of time, with another identity than the object's last one."""
    order = np.argsort(objects, kind="stable")
    same = np.diff(objects[order]) == 0
    return int(np.count_nonzero(same & (np.diff(identity[order]) != 0)))


def _two_sided(pairs: Pairs) -> I64:
    """Return the number of each frame among those with boxes of both sides, -1 for others."""
    both = np.ones(pairs.frames, np.bool_)
    for side in (pairs.truth, pairs.tracks):
        both &= np.bincount(side.frame, minlength=pairs.frames) > 0
    return np.where(both, np.cumsum(both) - 1, -1)


def _fragments(pairs: Pairs, hit: Mask, truth_id: I64) -> int:
    """Count how often a hit follows a frame without one, but for the first hit of each object."""
    number = _two_sided(pairs)[pairs.truth.frame[hit]]
    order = np.lexsort((number, truth_id[hit]))
    objects, number = truth_id[hit][order], number[order]
    goes_on = (np.diff(objects) == 0) & (np.diff(number) == 1)
    return int(len(objects) - np.count_nonzero(goes_on) - len(np.unique(objects)))


def _match(pairs: Pairs) -> I64:
    """Return the row of the track box that each true box is matched with, -1 for none, (G,)."""
    match = np.full(len(pairs.truth), -1)
    plain = pairs.plain_frames()
    settled = plain[pairs.frame]
    match[pairs.truth_row[settled]] = pairs.track_row[settled]
    two_sided = np.flatnonzero(_two_sided(pairs) >= 0)
    before = np.full(pairs.frames, -1)
    before[two_sided[1:]] = two_sided[:-1]
    edges = pairs.truth.edges(pairs.frames)
    crowded = np.flatnonzero(~plain)
    for frame, rows in zip(crowded.tolist(), pairs.by_frame(crowded), strict=True):
        last = before[frame]
        previous = slice(*edges[last : last + 2]) if last >= 0 else slice(0, 0)
        match[rows.truth] = _match_frame(pairs, rows, match, previous)
    return match


def _match_frame(pairs: Pairs, rows: FrameRows, match: I64, previous: slice) -> I64:
    """Return the matches of one frame; `previous` are the true boxes of the frame before."""
    score = pairs.matrix(rows, pairs.similarity, 0.0)
    hit = match[previous] >= 0
    identity_of = dict(
        zip(
            pairs.truth.id[previous][hit].tolist(),
            pairs.tracks.id[match[previous][hit]].tolist(),
            strict=True,
        )
    )
    column_of = {identity: k for k, identity in enumerate(pairs.tracks.id[rows.tracks].tolist())}
    for row, name in enumerate(pairs.truth.id[rows.truth].tolist()):
        column = column_of.get(identity_of[name], -1) if name in identity_of else -1
        if column >= 0 and score[row, column] > 0.0:
            score[row, column] += CONTINUES
    found = np.full(len(score), -1)
    i, j = linear_sum_assignment(score, maximize=True)
    good = score[i, j] > ROUNDING
    found[i[good]] = rows.tracks.start + j[good]
    return found

"""HOTA, higher-order tracking accuracy (Luiten et al., 2020)."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.eval import arithmetic
from mottrack.eval.assignment import most_gain
from mottrack.eval.pairs import Pairs

ALPHAS = np.arange(0.05, 0.99, 0.05)
"""The 19 localisation thresholds 0.05, 0.10, ..., 0.95 of the paper, section 5.4."""
_ROUNDING = float(np.finfo(np.float64).eps)  # as TrackEval: a similarity of alpha itself counts


@dataclass(frozen=True, slots=True)
class HotaCounts:
    """Sums per localisation threshold alpha, (19,) each; they add up over sequences."""

    true_positives: F64
    false_negatives: F64
    false_positives: F64
    localisation: F64
    """Sum of the similarity of the true positives."""
    association: F64
    """Sum over true positives of |TPA| / (|TPA| + |FNA| + |FPA|)."""
    association_recall: F64
    association_precision: F64


@dataclass(frozen=True, slots=True)
class Hota:
    """HOTA and its parts per alpha, (19,) each; the reported score is the mean over alpha."""

    hota: F64
    det_a: F64
    ass_a: F64
    loc_a: F64
    det_re: F64
    det_pr: F64
    ass_re: F64
    ass_pr: F64

    def as_dict(self) -> dict[str, float]:
        """Return the mean of each over alpha."""
        return {name: float(getattr(self, name).mean()) for name in self.__dataclass_fields__}


def hota_counts(pairs: Pairs) -> HotaCounts:
    """Return the sums of one sequence from all its pairs of positive similarity, not gated."""
    truth_id, track_id = pairs.truth.dense_ids(), pairs.tracks.dense_ids()
    truth_length, track_length = np.bincount(truth_id), np.bincount(track_id)
    alignment = _alignment(pairs, truth_id, track_id)
    matched, similarity = _match(pairs, alignment, truth_id, track_id)
    sums = {name: np.zeros(len(ALPHAS)) for name in HotaCounts.__dataclass_fields__}
    both, number = np.unique(matched[:, 0] * (len(track_length) + 1) + matched[:, 1], False, True)
    first, second = np.divmod(both, len(track_length) + 1)
    for a, alpha in enumerate(ALPHAS):
        good = similarity >= alpha - _ROUNDING
        every = np.bincount(number[good], minlength=len(both))
        there = every > 0
        frames = every[there]
        truth_frames, track_frames = truth_length[first[there]], track_length[second[there]]
        hits = int(np.count_nonzero(good))
        sums["true_positives"][a] = hits
        sums["false_negatives"][a] = len(truth_id) - hits
        sums["false_positives"][a] = len(track_id) - hits
        sums["localisation"][a] = similarity[good].sum()
        sums["association"][a] = (frames * frames / (truth_frames + track_frames - frames)).sum()
        sums["association_recall"][a] = (frames * frames / truth_frames).sum()
        sums["association_precision"][a] = (frames * frames / track_frames).sum()
    return HotaCounts(**sums)


def _alignment(pairs: Pairs, truth_id: I64, track_id: I64) -> F64:
    """Return the alignment score of the two identities of each pair (section 5.2), (P,)."""
    truth_length, track_length = np.bincount(truth_id), np.bincount(track_id)
    per_truth = np.bincount(pairs.truth_row, pairs.similarity, minlength=len(truth_id))
    per_track = np.bincount(pairs.track_row, pairs.similarity, minlength=len(track_id))
    union = per_truth[pairs.truth_row] + per_track[pairs.track_row] - pairs.similarity
    first, second = truth_id[pairs.truth_row], track_id[pairs.track_row]
    _, both = np.unique(first * (len(track_length) + 1) + second, return_inverse=True)
    potential = np.bincount(both, pairs.similarity / union)[both]
    return potential / (truth_length[first] + track_length[second] - potential)


def _match(pairs: Pairs, alignment: F64, truth_id: I64, track_id: I64) -> tuple[I64, F64]:
    """Return matched identities (M, 2) and similarity (M,), the same for every alpha."""
    gain = alignment * pairs.similarity
    plain = pairs.plain_frames()
    chosen = plain[pairs.frame]
    for rows in pairs.by_frame(np.flatnonzero(~plain)):
        i = pairs.truth_row[rows.pairs] - rows.truth.start
        j = pairs.track_row[rows.pairs] - rows.tracks.start
        boxes = (rows.truth.stop - rows.truth.start, rows.tracks.stop - rows.tracks.start)
        chosen[rows.pairs.start + most_gain(i, j, gain[rows.pairs], boxes)] = True
    ids = [truth_id[pairs.truth_row[chosen]], track_id[pairs.track_row[chosen]]]
    return np.stack(ids, axis=1), pairs.similarity[chosen]


def total(counts: Iterable[HotaCounts]) -> HotaCounts:
    """Return the sums of several sequences or classes together."""
    return arithmetic.total(counts, HotaCounts(*(7 * [np.zeros(len(ALPHAS))])))


def hota(counts: HotaCounts) -> Hota:
    """Return HOTA = sqrt(DetA * AssA) and its parts; a part without any count is 0."""
    hits, misses, extra = counts.true_positives, counts.false_negatives, counts.false_positives
    det_a = hits / np.maximum(1.0, hits + misses + extra)
    ass_a = counts.association / np.maximum(1.0, hits)
    return Hota(
        hota=np.sqrt(det_a * ass_a),
        det_a=det_a,
        ass_a=ass_a,
        # TrackEval's bound: without any match LocA is 1
        loc_a=np.maximum(1e-10, counts.localisation) / np.maximum(1e-10, hits),
        det_re=hits / np.maximum(1.0, hits + misses),
        det_pr=hits / np.maximum(1.0, hits + extra),
        ass_re=counts.association_recall / np.maximum(1.0, hits),
        ass_pr=counts.association_precision / np.maximum(1.0, hits),
    )

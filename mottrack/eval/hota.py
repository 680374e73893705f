"""HOTA, higher-order tracking accuracy (Luiten et al., 2020)."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from mottrack.core.arrays import F64, I64
from mottrack.eval.pairs import Pairs

ALPHAS: F64 = np.arange(0.05, 0.99, 0.05)
_SLACK = float(np.finfo(np.float64).eps)


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
    """HOTA and its parts per alpha, (19,) each; a reported figure is the mean over alpha."""

    hota: F64
    det_a: F64
    ass_a: F64
    loc_a: F64
    det_re: F64
    det_pr: F64
    ass_re: F64
    ass_pr: F64

    def as_dict(self) -> dict[str, float]:
        """The mean of each over alpha."""
        return {name: float(getattr(self, name).mean()) for name in self.__dataclass_fields__}


def hota_counts(pairs: Pairs) -> HotaCounts:
    """The sums of one sequence. Wants all pairs of positive similarity, not gated ones."""
    truth_id, track_id = pairs.truth.dense_ids(), pairs.tracks.dense_ids()
    truth_length, track_length = np.bincount(truth_id), np.bincount(track_id)
    alignment = _alignment(pairs, truth_id, track_id)
    matched, similarity = _match(pairs, alignment, truth_id, track_id)
    sums = {name: np.zeros(len(ALPHAS)) for name in HotaCounts.__dataclass_fields__}
    for a, alpha in enumerate(ALPHAS):
        good = similarity >= alpha - _SLACK
        ids, frames = np.unique(matched[good], axis=0, return_counts=True)
        truth_frames, track_frames = truth_length[ids[:, 0]], track_length[ids[:, 1]]
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
    """Global alignment score of every true with every tracked identity (paper, section 5.2)."""
    truth_length, track_length = np.bincount(truth_id), np.bincount(track_id)
    per_truth = np.bincount(pairs.truth_row, pairs.similarity, minlength=len(truth_id))
    per_track = np.bincount(pairs.track_row, pairs.similarity, minlength=len(track_id))
    union = per_truth[pairs.truth_row] + per_track[pairs.track_row] - pairs.similarity
    potential = np.zeros((len(truth_length), len(track_length)))
    where = (truth_id[pairs.truth_row], track_id[pairs.track_row])
    np.add.at(potential, where, pairs.similarity / union)
    whole: F64 = truth_length[:, None] + track_length[None, :] - potential
    return potential / whole


def _match(pairs: Pairs, alignment: F64, truth_id: I64, track_id: I64) -> tuple[I64, F64]:
    """Matched identities (M, 2) and similarity (M,), the same for every alpha."""
    matched, kept = [np.zeros((0, 2), np.int64)], [np.zeros(0)]
    for rows, columns, span in pairs.by_frame():
        if span.start == span.stop:
            continue
        similarity = np.zeros((rows.stop - rows.start, columns.stop - columns.start))
        i, j = pairs.truth_row[span] - rows.start, pairs.track_row[span] - columns.start
        similarity[i, j] = pairs.similarity[span]
        score = alignment[np.ix_(truth_id[rows], track_id[columns])] * similarity
        i, j = linear_sum_assignment(-score)
        matched.append(np.stack([truth_id[rows][i], track_id[columns][j]], axis=1))
        kept.append(similarity[i, j])
    return np.concatenate(matched), np.concatenate(kept)


def total(counts: Iterable[HotaCounts]) -> HotaCounts:
    """The sums of several sequences or classes together."""
    listed = list(counts)
    zero = np.zeros(len(ALPHAS))
    names = HotaCounts.__dataclass_fields__
    return HotaCounts(**{n: sum((getattr(c, n) for c in listed), start=zero) for n in names})


def hota(counts: HotaCounts) -> Hota:
    """HOTA = sqrt(DetA * AssA) and its parts; a part is 0 where nothing could be counted."""
    hits, misses, extra = counts.true_positives, counts.false_negatives, counts.false_positives
    det_a = hits / np.maximum(1.0, hits + misses + extra)
    ass_a = counts.association / np.maximum(1.0, hits)
    return Hota(
        hota=np.sqrt(det_a * ass_a),
        det_a=det_a,
        ass_a=ass_a,
        loc_a=np.maximum(1e-10, counts.localisation) / np.maximum(1e-10, hits),
        det_re=hits / np.maximum(1.0, hits + misses),
        det_pr=hits / np.maximum(1.0, hits + extra),
        ass_re=counts.association_recall / np.maximum(1.0, hits),
        ass_pr=counts.association_precision / np.maximum(1.0, hits),
    )

"""sAMOTA, AMOTA, AMOTP and MOTA on resampled sequences, exactly.

The counts of a sequence change only at the scores of its own tracks, so they are taken once at each
of these; on a resample the forty thresholds are chosen anew from the matched scores, and the counts
of each sequence are looked up. The official code takes the mean of a track's scores again in every
pass, which moves last bits: a track whose score is the threshold itself takes part in some passes
and not in others. Of few tracks that is a large share, so it is kept here too.
"""

from __future__ import annotations

from collections.abc import Sequence as Listed
from dataclasses import astuple, dataclass, fields

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.eval.arithmetic import ratio
from mottrack.eval.kitti.levels import KittiCounts, KittiMetrics, count, thresholds
from mottrack.eval.kitti.matching import KittiRules, Sequence, match, mean_over_tracks
from mottrack.eval.paired import Sampled

AVERAGES = ("samota", "amota", "amotp", "mota", "motp")
_COLUMN = {field.name: k for k, field in enumerate(fields(KittiCounts))}


@dataclass(frozen=True, slots=True)
class Profile:
    """One sequence at every threshold."""

    scores: F64
    """(K,) different scores of its tracks, ascending."""
    counts: F64
    """(K + 1, fields of KittiCounts) with the tracks from that score on; the last: without any."""
    matched: F64
    """(M,) scores of the boxes that match where all tracks take part."""
    stays: Mask
    """(K, levels) whether a track of that score, if it is the threshold, takes part in a level."""

    @property
    def boxes(self) -> float:
        """Matches and misses where all tracks take part."""
        return float(self.counts[0, _COLUMN["tp"]] + self.counts[0, _COLUMN["fn"]])


def profile(sequence: Sequence, rules: KittiRules) -> Profile:
    """Count a sequence at every score of its tracks."""
    score = mean_over_tracks(sequence, sequence.tracks.score)
    scores, first = np.unique(score, return_index=True)
    rows, matched = [], np.zeros(0)
    for threshold in [*scores.tolist(), np.inf]:
        found = match(sequence, score >= threshold, rules.min_iou)
        rows.append(astuple(count(sequence, found)))
        if len(rows) == 1:
            matched = score[found.track_row[found.track_row >= 0]]
    stays = np.zeros((len(scores), rules.levels), np.bool_)
    again = score
    for level in range(rules.levels):
        again = mean_over_tracks(sequence, again)
        stays[:, level] = again[first] >= scores
    return Profile(scores, np.array(rows, np.float64), matched, stays)


def _rows(found: Profile, threshold: F64) -> I64:
    """Return the row of the counts at each level's threshold, (L,)."""
    row = np.searchsorted(found.scores, threshold)
    own = np.append(found.scores, np.inf)[row] == threshold
    stays = np.vstack([found.stays, np.ones((1, found.stays.shape[1]), np.bool_)])
    return np.asarray(row + (own & ~stays[row, np.arange(len(threshold))]), np.int64)


def resampled(metrics: KittiMetrics, profiles: Listed[Profile], weights: I64) -> dict[str, Sampled]:
    """Return the averages and the best level's metrics with their draws.

    Args:
        metrics: of the whole.
        profiles: of the S sequences.
        weights: (B, S) how often each sequence counts.
    """
    draws = np.array([_averages(profiles, weight, metrics.rules.levels) for weight in weights])
    present: Mask = np.array([p.counts[0, _COLUMN["truth"]] > 0 for p in profiles])
    whole = metrics.as_dict()
    return {name: Sampled(whole[name], draws[:, k], present) for k, name in enumerate(AVERAGES)}


def _averages(profiles: Listed[Profile], weight: I64, levels: int) -> F64:
    """Return `AVERAGES` of one resample; NaN without truth."""
    boxes = sum(w * p.boxes for w, p in zip(weight.tolist(), profiles, strict=True))
    scores = [np.repeat(p.matched, w) for w, p in zip(weight.tolist(), profiles, strict=True)]
    grid = thresholds(np.concatenate(scores), boxes, levels) if boxes else []
    if not grid:
        return np.full(len(AVERAGES), np.nan)
    threshold, recall = np.array(grid).T
    counts = sum(
        w * p.counts[_rows(p, threshold)] for w, p in zip(weight.tolist(), profiles, strict=True)
    )
    c = {name: np.asarray(counts)[:, k] for name, k in _COLUMN.items()}
    errors = c["fn"] + c["fp"] + c["ids"]
    mota = 1.0 - ratio(errors, c["truth"])
    scaled = 1.0 - ratio(errors - (1.0 - recall) * c["truth"], recall * c["truth"])
    motp = np.nan_to_num(ratio(c["iou"], c["tp"]))
    best = int(np.argmax(mota))
    averages = [np.clip(scaled, 0.0, 1.0).sum(), mota.sum(), motp.sum()]
    return np.array([*(a / levels for a in averages), mota[best], motp[best]])

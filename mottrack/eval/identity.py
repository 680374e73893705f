"""Identity measures: IDF1, IDP, IDR (Ristani et al., 2016)."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mottrack.eval import arithmetic
from mottrack.eval.assignment import most_gain
from mottrack.eval.pairs import Pairs


@dataclass(frozen=True, slots=True)
class IdentityCounts:
    """Boxes whose identity is right under the best one-to-one map of whole tracks; they add up."""

    true_positives: int = 0
    truth: int = 0
    tracked: int = 0

    @property
    def idf1(self) -> float:
        """2 IDTP / (truth + tracked); NaN where there is neither."""
        return arithmetic.ratio(2 * self.true_positives, self.truth + self.tracked)

    @property
    def idp(self) -> float:
        """IDTP / tracked boxes; NaN without tracks."""
        return arithmetic.ratio(self.true_positives, self.tracked)

    @property
    def idr(self) -> float:
        """IDTP / true boxes; NaN without truth."""
        return arithmetic.ratio(self.true_positives, self.truth)


def identity_counts(pairs: Pairs) -> IdentityCounts:
    """Return the counts of one sequence; every listed pair is an overlap: gate them before."""
    truth_id, track_id = pairs.truth.dense_ids(), pairs.tracks.dense_ids()
    tracks = int(track_id.max(initial=-1)) + 1
    key = truth_id[pairs.truth_row] * tracks + track_id[pairs.track_row]
    both, shared = np.unique(key, return_counts=True)
    shape = (int(truth_id.max(initial=-1)) + 1, tracks)
    row, column = np.divmod(both, max(tracks, 1))
    agreed = shared[most_gain(row, column, shared.astype(np.float64), shape)]
    return IdentityCounts(int(agreed.sum()), len(truth_id), len(track_id))


def total(counts: Iterable[IdentityCounts]) -> IdentityCounts:
    """Return the counts of several sequences or classes together."""
    return arithmetic.total(counts, IdentityCounts())

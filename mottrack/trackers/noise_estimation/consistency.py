"""Whether a filter's covariances are honest: chi-square tests of NIS and NEES.

For an honest filter the normalised squared innovation (NIS) and estimation error (NEES) follow a
chi-square law whose mean is the number of components (Bar-Shalom, Li and Kirubarajan, 2001, 5.4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F64
from mottrack.core.objects import Objects, Tracks, Truth
from mottrack.trackers.kalman.state import PLANAR
from mottrack.trackers.noise_estimation.samples import match_truth


@dataclass(frozen=True, slots=True)
class Consistency:
    """Summary of N normalised squared errors of `components` numbers each."""

    count: int
    components: int
    mean_ratio: float
    """Mean over its expectation: 1 is honest, above 1 the filter is too sure of itself."""
    inside_95: float
    """Part below the 95 % quantile of the chi-square law."""


def consistency(squared: F64, components: int) -> Consistency:
    """Holds normalised squared errors (N,) against the chi-square law of `components`."""
    # scipy.stats takes long to load, and trackers that run have no use for it
    from scipy.stats import chi2

    if len(squared) == 0:
        return Consistency(0, components, float("nan"), float("nan"))
    inside = squared <= chi2.ppf(0.95, components)
    return Consistency(
        len(squared), components, float(squared.mean() / components), float(inside.mean())
    )


def nees(tracks: Tracks, truth: Truth) -> F64:
    """Normalised squared error of (x, y, d_x, d_y), (N,), of the tracks that match a true box.

    Tracks with a state of the Kalman tracker, in seconds, of truth whose velocity is known.
    """
    seen = tracks.select(tracks.observed)
    boxes = Objects(
        stamp_ns=seen.stamp_ns,
        frame=seen.frame,
        centre_m=seen.centre_m,
        size_m=seen.size_m,
        yaw_rad=seen.yaw_rad,
        label=seen.label,
        score=seen.score,
    )
    i, j = match_truth(boxes, truth)
    known = np.isfinite(truth.velocity_mps[j]).all(axis=1)
    i, j = i[known], j[known]
    true = np.hstack([truth.centre_m[j, :2], truth.velocity_mps[j]])
    error = seen.state[i][:, PLANAR] - true
    spread = seen.covariance[i][:, np.array(PLANAR)[:, None], PLANAR]
    solved = np.linalg.solve(spread, error[:, :, None])[:, :, 0]
    return np.asarray(np.einsum("nd,nd->n", error, solved))

"""Consistency of a filter's covariances: chi-square tests of NIS and NEES.

For a consistent filter the normalised squared innovation (NIS) and estimation error (NEES) follow a
chi-square law whose mean is the number of components (Bar-Shalom, Li and Kirubarajan, 2001, 5.4).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mottrack.core.arrays import F64, Texts
from mottrack.core.objects import Tracks, Truth
from mottrack.trackers.kalman.state import XY_VELOCITY
from mottrack.trackers.noise_estimation.samples import match_truth


@dataclass(frozen=True, slots=True)
class Consistency:
    """Summary of N normalised squared errors of `components` numbers each."""

    count: int
    components: int
    mean_ratio: float
    """Mean over its expectation: 1 is consistent, above 1 the filter is overconfident."""
    inside_95: float
    """Fraction below the 95 % quantile of the chi-square law."""


def consistency(squared: F64, components: int) -> Consistency:
    """Compare normalised squared errors (N,) with the chi-square law of `components` degrees."""
    # scipy.stats loads slowly and only the study of noise needs it
    from scipy.stats import chi2

    if len(squared) == 0:
        return Consistency(0, components, float("nan"), float("nan"))
    inside = squared <= chi2.ppf(0.95, components)
    return Consistency(
        len(squared), components, float(squared.mean() / components), float(inside.mean())
    )


class StateErrors(NamedTuple):
    """Normalised squared errors of N tracks, and their classes."""

    squared: F64
    """(N,)"""
    label: Texts
    """(N,)"""


def nees(tracks: Tracks, truth: Truth) -> StateErrors:
    """Return the normalised squared errors of (x, y, d_x, d_y) of tracks that match the truth.

    `tracks` carry the state of a Kalman tracker in seconds; only truth of known velocity counts.
    """
    seen = tracks.select(tracks.observed)
    i, j = match_truth(seen, truth)
    known = np.isfinite(truth.velocity_mps[j]).all(axis=1)
    i, j = i[known], j[known]
    true = np.hstack([truth.centre_m[j, :2], truth.velocity_mps[j]])
    error = seen.state[i][:, XY_VELOCITY] - true
    spread = seen.covariance[i][:, np.array(XY_VELOCITY)[:, None], XY_VELOCITY]
    solved = np.linalg.solve(spread, error[:, :, None])[:, :, 0]
    return StateErrors(np.sum(error * solved, axis=1), seen.label[i])

"""Velocity of labelled boxes by a robust fit through the boxes of their track.

Annotated centres are noisy: KITTI's steps are off by 0.15 to 0.55 m/s with the range, and boxes of
PandaSet that two sensors saw lie 50 ms of motion ahead in every fifth frame. A difference of two
neighbours carries that noise; a quadratic through all boxes within 0.6 s averages it, and its
robust weights leave out the boxes that jump.
"""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F64, I64, Mask
from mottrack.core.label_velocities import centred_velocities
from mottrack.core.sweep import SECOND_NS

HALF_WINDOW_S = 0.6
"""Six frames at 10 Hz to either side: a vehicle's acceleration is about constant for a second."""
_HALF_FRAME_S = 0.05
"""Stamps jitter: a box half a frame of 10 Hz beyond the window still belongs to it."""
_LEAST_OF_QUADRATIC = 5
"""Boxes of a quadratic; fewer have no more than one to spare for noise: a line."""
_LEAST_OF_LINE = 2
"""Boxes that have a slope."""
_ITERATIONS = 8
"""Steps of the reweighting: it starts from least squares, which are close."""
_CAUCHY = 2.385
"""Residual over scale at which a box's weight is halved: 95 % efficient for Gaussian noise."""
_LEAST_SCALE_M = 0.01
"""Labels are rounded to a centimetre: no residual below it makes a box an outlier."""
_MAD_TO_SIGMA = 1.4826
"""Standard deviation of a Gaussian over its median absolute deviation."""
_PRIOR_ACCELERATION_MPS2 = 3.0
"""Standard deviation of an acceleration: at the ends of a track a quadratic without this prior
takes the noise of the last box for one."""
_PRIOR_NOISE_M = 0.1
"""Noise of a box against which the prior is weighed: that of KITTI's labels."""


def box_velocities(track_id: I64, stamp_ns: I64, position_m: F64, *, fitted: bool) -> F64:
    """Return (N, 2) ground velocities in m/s of N labelled boxes in the world, NaN where unknown.

    Args:
        track_id: (N,) which track each box belongs to.
        stamp_ns: (N,) time of each box.
        position_m: (N, 2) or (N, 3) centre in the world frame.
        fitted: fit each track over time; otherwise the centred difference of its neighbours.
    """
    centred_mps = centred_velocities(track_id, stamp_ns, position_m)
    if not fitted:
        return centred_mps
    velocity_mps = fitted_slopes(track_id, stamp_ns, position_m[:, :2])
    known = np.asarray(np.isfinite(velocity_mps).all(axis=1))
    return np.where(known[:, None], velocity_mps, centred_mps)


def fitted_slopes(track_id: I64, stamp_ns: I64, values: F64) -> F64:
    """Return (N, D) rates of change a second of the values (N, D) of N boxes at their own times.

    Each is the slope of a quadratic (of a line with fewer than five boxes) through the values of
    its track within `HALF_WINDOW_S`, by iteratively reweighted least squares with Cauchy weights.
    NaN where a box is alone in its window.
    """
    slopes = np.full(values.shape, np.nan)
    order = np.lexsort((stamp_ns, track_id))
    starts = np.flatnonzero(np.diff(track_id[order], prepend=track_id[order][:1] - 1))
    for rows in np.split(order, starts[1:]):
        if len(rows) >= _LEAST_OF_LINE:
            slopes[rows] = _track_slopes(stamp_ns[rows], values[rows])
    return slopes


def _track_slopes(stamp_ns: I64, values: F64) -> F64:
    """Return the slopes (N, D) of one track, ascending in time."""
    time_s = (stamp_ns - stamp_ns[0]) / SECOND_NS
    reach_s = HALF_WINDOW_S + _HALF_FRAME_S
    first = np.searchsorted(time_s, time_s - reach_s)
    last = np.searchsorted(time_s, time_s + reach_s)
    columns = first[:, None] + np.arange((last - first).max())
    used = columns < last[:, None]
    columns = np.minimum(columns, len(time_s) - 1)
    since_s = np.where(used, time_s[columns] - time_s[:, None], 0.0)
    slopes = _robust_slopes(since_s, values[columns], used)
    slopes[used.sum(axis=1) < _LEAST_OF_LINE] = np.nan
    return slopes


def _robust_slopes(since_s: F64, values: F64, used: Mask) -> F64:
    """Return the slopes (N, D) at zero of windows: times (N, W), values (N, W, D), used (N, W)."""
    count = used.sum(axis=1)
    terms = np.stack([np.ones_like(since_s), since_s, 0.5 * since_s**2], axis=-1)
    prior = np.zeros((len(count), 3, 3))
    prior[:, 2, 2] = np.where(
        count >= _LEAST_OF_QUADRATIC, (_PRIOR_NOISE_M / _PRIOR_ACCELERATION_MPS2) ** 2, 1e9
    )
    prior[:, 1, 1] = 1e-12  # a window of one box has no slope; the caller leaves it out
    weights = used.astype(np.float64)
    slopes = np.zeros((len(count), values.shape[2]))
    for _ in range(_ITERATIONS):
        weighted = weights[..., None] * terms
        matrix = np.einsum("nwi,nwj->nij", weighted, terms) + prior
        vector = np.einsum("nwi,nwd->nid", weighted, values - values[:, :1])
        solution = np.linalg.solve(matrix, vector)
        slopes = solution[:, 1]
        residual = np.linalg.norm(values - values[:, :1] - terms @ solution, axis=-1)
        middle = np.nanmedian(np.where(used, residual, np.nan), axis=1, keepdims=True)
        scale = np.maximum(_MAD_TO_SIGMA * middle, _LEAST_SCALE_M)
        weights = used / (1.0 + (residual / (_CAUCHY * scale)) ** 2)
    return slopes

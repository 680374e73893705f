"""The Mahalanobis distance of listed pairs of detection and track, compiled."""

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, I64, Mask
from mottrack.trackers.kalman.state import YAW
from mottrack.trackers.kalman.velocity_belief import SMALLEST

Observed = tuple[F64, F64, F64, F64, F64, Mask, F64, F64]
"""box, position, axial, velocity, velocity_covariance, moving, no_news, stray of `Detections`."""
Expected = tuple[F64, F64, F64]
"""mean, planar, axial of `Predicted`."""

LOG_2_PI = float(np.log(2.0 * np.pi))


@compiled
def pair_terms(
    pairs: tuple[I64, I64], seen: Observed, tracks: Expected, how: tuple[int, int, float]
) -> tuple[F64, F64]:
    """Distance r' S^-1 r and surprise -2 ln p(o_hat | track) + 2 ln p(d | stray), (P,) twice.

    S = H P H' + R is taken block by block: (x, y), the box's numbers from `how[0]` up to `how[1]`,
    and where a velocity was measured (d_x, d_y) given (x, y). That adds at most `how[2]` to the
    distance; below 0 velocities are left alone. In the surprise it is sound or a failure of its
    source (`velocity_belief`), so a velocity that only this track explains speaks for the pair.
    """
    first, last, limit = how
    rows, columns = pairs
    squared, surprise = np.empty(len(rows)), np.empty(len(rows))
    for p in range(len(rows)):
        i, j = rows[p], columns[p]
        s = tracks[1][j][:2, :2] + seen[1][i]
        dx, dy = seen[0][i, 0] - tracks[0][j, 0], seen[0][i, 1] - tracks[0][j, 1]
        squared[p] = _quadratic(s, dx, dy)
        for k in range(first, last):
            difference = seen[0][i, k] - tracks[0][j, k]
            if k == YAW:
                difference = _modulo_pi(difference)
            squared[p] += difference**2 / (tracks[2][j, k - 2] + seen[2][i, k - 2])
        surprise[p] = squared[p] + 2.0 * LOG_2_PI + np.log(_determinant(s))
        if limit >= 0.0 and seen[5][i]:
            added, spread = _velocity_terms(seen, tracks, (i, j), (s, dx, dy))
            density = np.exp(-0.5 * added) / (2.0 * np.pi * np.sqrt(spread))
            surprise[p] += 2.0 * np.log(seen[7][i] / max(density + seen[6][i], SMALLEST))
            squared[p] += min(added, limit)
    return squared, surprise


@compiled
def _velocity_terms(
    seen: Observed, tracks: Expected, pair: tuple[int, int], centre: tuple[F64, float, float]
) -> tuple[float, float]:
    """Of the velocity, given the centre with its S and residual: r' S^-1 r and det S."""
    i, j = pair
    s, dx, dy = centre
    planar = tracks[1][j]
    determinant = _determinant(s)
    given = planar[2:, 2:] + seen[4][i]
    r = np.empty(2)
    gain = np.empty((2, 2))
    for k in range(2):
        x, y = planar[k + 2, 0], planar[k + 2, 1]
        gain[k, 0] = (x * s[1, 1] - y * s[0, 1]) / determinant
        gain[k, 1] = (y * s[0, 0] - x * s[0, 1]) / determinant
        expected = tracks[0][j, k + 7] + gain[k, 0] * dx + gain[k, 1] * dy
        r[k] = seen[3][i, k] - expected
    for k in range(2):
        for c in range(2):
            given[k, c] -= gain[k, 0] * planar[0, c + 2] + gain[k, 1] * planar[1, c + 2]
    return _quadratic(given, r[0], r[1]), _determinant(given)


@compiled
def _determinant(s: F64) -> float:
    return float(s[0, 0] * s[1, 1] - s[0, 1] * s[0, 1])


@compiled
def _quadratic(s: F64, x: float, y: float) -> float:
    """Quadratic form v' S^-1 v."""
    return float((s[1, 1] * x * x - 2.0 * s[0, 1] * x * y + s[0, 0] * y * y) / _determinant(s))


@compiled
def _modulo_pi(angle: float) -> float:
    """In [-pi/2, pi/2): a box says little of front and rear."""
    return float((angle + 0.5 * np.pi) % np.pi - 0.5 * np.pi)

"""Who may stay where: things placed at random must not stand in each other."""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F64, I64, Mask

_SLACK_M = 0.15


def first_come(place: F64, size_m: F64, together: I64) -> Mask:
    """(N,) who stays: each unless it overlaps somebody before it who stays.

    Footprints are taken as three circles along their length.

    Args:
        place: (N, 3) x, y, heading.
        size_m: (N, 3) length, width, height.
        together: (N,) number of the party; members of one party do not disturb each other.
    """
    circles, radius = _circles(place, size_m)
    keep = np.ones(len(place), dtype=np.bool_)
    for i in range(1, len(place)):
        apart = circles[i][:, None, None, :] - circles[None, :i]
        gap = np.hypot(apart[..., 0], apart[..., 1]).min(axis=(0, 2)) - radius[i] - radius[:i]
        keep[i] = not (keep[:i] & (together[:i] != together[i]) & (gap < _SLACK_M)).any()
    return keep


def _circles(place: F64, size_m: F64) -> tuple[F64, F64]:
    """(N, 3, 2) middles and (N,) radius of three circles along each footprint."""
    radius = 0.55 * size_m[:, 1]
    reach = np.maximum(0.5 * size_m[:, 0] - radius, 0.0)
    ahead = np.stack([np.cos(place[:, 2]), np.sin(place[:, 2])], axis=-1)
    steps = np.array([-1.0, 0.0, 1.0])
    return place[:, None, :2] + (reach[:, None] * steps)[..., None] * ahead[:, None], radius

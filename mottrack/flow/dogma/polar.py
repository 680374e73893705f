"""What a sweep says along each direction: how far the view is free."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F32, U8, Mask
from mottrack.flow.dogma.returns import GROUND, OBSTACLE, OWN


class Blind(NamedTuple):
    """What to make of directions without a return."""

    widest_gap_rad: float
    """A wider gap without any return lies outside the field of view."""
    no_return_free_m: float
    """Free reach where the sensor looked and nothing came back."""


def free_reach_m(xy_m: F32, kind: U8, bins: int, blind: Blind) -> F32:
    """(A,) how far each azimuth bin is seen free from the optical centre; bin 0 begins at -pi.

    The first obstacle of a direction ends its free reach, else the farthest ground point. `xy_m`
    (N, 2) are relative to the optical centre, `kind` (N,) says what they are. Where a direction
    inside the field of view shows neither, it is free as far as `blind` says.
    """
    first_m, ground_m, hit = _extremes(xy_m, kind, bins)
    looked = ~_wide_gaps(hit, round(blind.widest_gap_rad / (2 * np.pi) * bins))
    open_m = np.maximum(ground_m, np.where(looked, np.float32(blind.no_return_free_m), 0))
    return np.asarray(np.where(np.isinf(first_m), open_m, first_m), np.float32)


def _wide_gaps(hit: Mask, widest: int) -> Mask:
    """Bins in circular runs of more than `widest` bins without a return."""
    bins = len(hit)
    if not hit.any():
        return np.ones(bins, np.bool_)
    seen = np.flatnonzero(hit)
    following = np.append(seen[1:], seen[0] + bins)
    wide = np.zeros(bins, np.bool_)
    for begin, end in zip(seen, following, strict=True):
        if end - begin - 1 > widest:
            wide[np.arange(begin + 1, end) % bins] = True
    return wide


@compiled(nogil=True)
def _extremes(xy_m: F32, kind: U8, bins: int) -> tuple[F32, F32, Mask]:
    """Nearest obstacle, farthest ground point and whether there is any return, per bin."""
    first_m = np.full(bins, np.inf, np.float32)
    ground_m = np.zeros(bins, np.float32)
    hit = np.zeros(bins, np.bool_)
    per_rad = np.float32(bins / (2 * np.pi))
    for i in range(len(xy_m)):
        if kind[i] == OWN:
            continue
        x_m, y_m = xy_m[i, 0], xy_m[i, 1]
        turned = (np.arctan2(y_m, x_m) + np.float32(np.pi)) * per_rad
        b = min(int(turned), bins - 1)
        range_m = np.sqrt(x_m * x_m + y_m * y_m)
        hit[b] = True
        if kind[i] == OBSTACLE:
            first_m[b] = min(first_m[b], range_m)
        elif kind[i] == GROUND:
            ground_m[b] = max(ground_m[b], range_m)
    return first_m, ground_m, hit

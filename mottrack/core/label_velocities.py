"""Velocities of labelled boxes, from their places at other times."""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F64, I64
from mottrack.core.sweep import seconds_between

MAX_GAP_S = 1.5
"""nuScenes' rule: no velocity over a one-sided gap longer than this, or twice this centred."""


def centred_velocities(track_id: I64, stamp_ns: I64, position_m: F64) -> F64:
    """Return (N, 2) ground velocities in m/s of N labelled boxes given in the world frame.

    Between two neighbours of the same track the difference is centred, at a track's ends it is
    one-sided; a box alone in its track, or with a gap over `MAX_GAP_S`, has velocity NaN: it is
    unknown, which zero would not say.

    Args:
        track_id: (N,) which track each box belongs to.
        stamp_ns: (N,) time of each box.
        position_m: (N, 2) or (N, 3) centre in the world frame.
    """
    order = np.lexsort((stamp_ns, track_id))
    ids, stamps, xy = track_id[order], stamp_ns[order], position_m[order, :2]
    same = ids[1:] == ids[:-1]
    here = np.arange(len(ids))
    before = np.where(np.concatenate([[False], same])[: len(ids)], here - 1, here)
    after = np.where(np.concatenate([same, [False]])[: len(ids)], here + 1, here)
    elapsed_s = seconds_between(stamps[before], stamps[after])
    sides = (after != here).astype(int) + (before != here).astype(int)
    known = (elapsed_s > 0.0) & (elapsed_s <= MAX_GAP_S * sides)
    velocity = np.full((len(ids), 2), np.nan)
    velocity[order[known]] = (xy[after] - xy[before])[known] / elapsed_s[known, None]
    return velocity

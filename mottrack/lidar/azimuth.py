"""An arctangent that is quick enough to be taken of every point."""

from __future__ import annotations

import numpy as np

from mottrack.compiled import compiled


@compiled(fastmath=True)
def quick_atan2(y: float, x: float) -> float:
    """Angle of (x, y) in [-pi, pi], 1e-5 rad off at most; 0 at the origin.

    The odd polynomial of Abramowitz and Stegun 4.4.49 over one octant, unfolded by symmetry.
    """
    across, along = abs(y), abs(x)
    larger = max(across, along)
    if larger == 0.0:
        return 0.0
    t = min(across, along) / larger
    s = t * t
    angle = t * (0.9998660 + s * (-0.3302995 + s * (0.1801410 + s * (-0.0851330 + s * 0.0208351))))
    if across > along:
        angle = 0.5 * np.pi - angle
    if x < 0.0:
        angle = np.pi - angle
    return -angle if y < 0.0 else angle

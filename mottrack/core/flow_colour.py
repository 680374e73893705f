"""The Middlebury colour code of flow (Baker et al., IJCV 2011): hue is direction, pale is slow.

Directions run around a wheel of 55 colours with unequal arcs between the primaries, so that equal
differences of direction look about equally different.
"""

from __future__ import annotations

import numpy as np

from mottrack.core.arrays import F64, Floats

RED, YELLOW, GREEN = (255, 0, 0), (255, 255, 0), (0, 255, 0)
CYAN, BLUE, MAGENTA = (0, 255, 255), (0, 0, 255), (255, 0, 255)
ARCS = (
    (RED, YELLOW, 15), (YELLOW, GREEN, 6), (GREEN, CYAN, 4),
    (CYAN, BLUE, 11), (BLUE, MAGENTA, 13), (MAGENTA, RED, 6),
)  # fmt: skip
"""Start, end and number of colours of each arc, as published."""
TOO_FAST = 0.75  # Factor on the colours of speeds above the full one, as published
LEAST_COLOUR = 0.45  # Share of the full colour that can be told from white; chosen by eye


def colour_wheel() -> F64:
    """Return (55, 3) the colours of the wheel, RGB in [0, 1]."""
    arcs = [
        np.linspace(start, end, steps, endpoint=False, dtype=np.float64)
        for start, end, steps in ARCS
    ]
    return np.concatenate(arcs) / 255.0


def flow_to_rgb(velocity_mps: Floats, max_mps: float) -> F64:
    """Return the colours (..., 3) in [0, 1] of velocities (..., 2).

    Args:
        velocity_mps: velocity along x (right) and y (up) in the picture.
        max_mps: speed that gets the full colour; faster ones are darkened to three quarters.

    Returns:
        RGB colours; a velocity of zero is white.
    """
    x, y = velocity_mps[..., 0].astype(np.float64), velocity_mps[..., 1].astype(np.float64)
    radius = np.hypot(x, y) / max_mps
    wheel = colour_wheel()
    # the picture of the original has y downwards; here it points up, hence the sign
    position = (np.arctan2(y, -x) / np.pi + 1.0) / 2.0 * (len(wheel) - 1)
    low = np.floor(position).astype(np.int64)
    share = (position - low)[..., None]
    hue = (1 - share) * wheel[low % len(wheel)] + share * wheel[(low + 1) % len(wheel)]
    inside = (radius <= 1)[..., None]
    r = np.minimum(radius, 1.0)[..., None]
    return np.where(inside, 1 - r * (1 - hue), TOO_FAST * hue)


def bold_flow_to_rgb(velocity_mps: Floats, max_mps: float) -> F64:
    """Return the same colours, but slow velocities get at least a share of the full colour.

    For what is known to move and is drawn on white, where pale colours cannot be seen.
    """
    speed = np.hypot(velocity_mps[..., 0], velocity_mps[..., 1])
    shown = np.clip(speed, LEAST_COLOUR * max_mps, max_mps)
    stretch = shown / np.maximum(speed, 1e-6)
    return flow_to_rgb(velocity_mps * stretch[..., None], max_mps)
